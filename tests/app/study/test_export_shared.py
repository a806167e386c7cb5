"""The clips of a study over two Dask workers: the same study as in one process."""

import shutil
from pathlib import Path

import pytest

from app.study.design.plan import read_plan
from app.study.export import export_study
from app.study.make.workspace import ExportOptions
from processes.pool import JobPool
from tests.app.study.made_study import draw_noise, tree, write_inputs, write_plan

pytest.importorskip("distributed", reason="Dask is not installed (requirements-cluster.txt)")

from tests.processes.test_cluster import scheduler, workers

SYSTEMS, CLIPS = ["localnet", "globalnet"], ["kitchen", "garden"]


def test_two_workers_make_the_study_that_one_process_makes(tmp_path: Path) -> None:
    """The keys are drawn, so the copy gets that of the first."""
    write_inputs(tmp_path / "inputs", SYSTEMS, CLIPS)
    plan = read_plan(write_plan(tmp_path / "inputs", SYSTEMS, CLIPS))
    here = export_study(plan, tmp_path / "here", draw=draw_noise)
    key = tmp_path / "apart" / "researcher_only" / "key.json"
    key.parent.mkdir(parents=True)
    shutil.copy(here.key, key)
    with scheduler(tmp_path) as (_, file), workers(file, 2):
        options = ExportOptions(pool=JobPool(scheduler=file))
        apart = export_study(plan, tmp_path / "apart", options, draw=draw_noise)
    assert tree(apart.bundle) == tree(here.bundle)
    assert apart.key.read_bytes() == here.key.read_bytes()
