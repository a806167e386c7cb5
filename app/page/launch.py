"""Start the page: flags, weights and examples, then the models warm up behind it."""

from __future__ import annotations

import argparse
import atexit
import logging
import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from app import text
from app.config import (
    BUNDLED_WEIGHTS,
    EXAMPLES,
    AppConfig,
    default_body,
    default_host,
    default_port,
)
from app.errors import sentence_of

if TYPE_CHECKING:
    from gradio import Blocks

    from app.page.results.first_look_shown import FirstLookDesk
    from app.page.tabs.generate_run import Generate

log = logging.getLogger(__name__)


def parse_config(argv: list[str] | None = None) -> AppConfig:
    """Flags and environment as one checked configuration.

    Raises:
        RunError: when a value cannot be used.
    """
    parser = argparse.ArgumentParser(
        prog="app.py", description=text.TAGLINE, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--host", default=default_host(), help="address to listen on (default: %(default)s)"
    )
    parser.add_argument(
        "--port", type=int, default=default_port(), help="port (default: %(default)s)"
    )
    parser.add_argument(
        "--body", type=Path, default=default_body(), metavar="FILE",
        help="licensed SMPLX_NEUTRAL*.npz (default: $SMPLX_MODEL, else the open body)",
    )  # fmt: skip
    parser.add_argument(
        "--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR",
        help="folder of trained systems (default: the bundled ones)",
    )  # fmt: skip
    parser.add_argument(
        "--max-minutes", type=float, default=10.0, metavar="N",
        help="longest speech accepted (default: %(default)g)",
    )  # fmt: skip
    options = parser.parse_args(argv)
    return AppConfig(
        host=options.host,
        port=options.port,
        body=options.body,
        weights=options.weights,
        max_speech_s=60 * options.max_minutes,
    )


def launch(
    config: AppConfig, is_warmed_up: bool = True, generate: Generate | None = None
) -> Blocks:
    """Serve the page from threads of this process; its address is ``local_url`` of the result.

    Args:
        generate: does a run; None is the pipeline.
        is_warmed_up: whether the models are read as soon as the page is up, rather than at the
            first run.

    Raises:
        RunError, CheckpointError: if the weights cannot be offered.
        OSError: if the port is taken.
    """
    config.temp.mkdir(mode=0o700, parents=True, exist_ok=True)
    config.temp.chmod(0o700)
    # Gradio reads both when it is imported or launched.
    os.environ["GRADIO_TEMP_DIR"] = str(config.cache_folder)
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"

    from app.live.desk import LiveDesk
    from app.page.page import build_app
    from app.page.parts.catalogue import find_examples, read_catalogue
    from app.page.results.first_look_shown import FirstLookDesk
    from app.page.serving.jobs import JobBook
    from app.page.serving.live_route import live_routes
    from app.page.serving.media import MediaDesk, media_routes
    from app.page.serving.researcher_part import Handover, study_routes
    from app.page.theme import CSS, head_style, make_theme

    catalogue = read_catalogue(config.weights, find_examples(EXAMPLES))
    jobs = JobBook(config.jobs_folder, config.num_slots, config.max_waiting)
    jobs.keep_swept(config.keep_results_s)
    atexit.register(jobs.cancel_all)

    handover = Handover(config.private_folder, config.keep_results_s)
    desk = MediaDesk()
    live = LiveDesk(config.weights)
    examples = [example.path for example in catalogue.examples]
    first_look = FirstLookDesk(config, catalogue, jobs, desk) if is_warmed_up else None
    page = build_app(
        *(generate or _generate, catalogue, config, jobs, handover, desk, live, first_look)
    )
    page.queue(max_size=4 * config.max_waiting)
    routes = [*media_routes(desk), *study_routes(handover), *live_routes(live, examples)]
    page.launch(
        server_name=config.host,
        server_port=config.port or None,  # 0: any free one
        share=False,
        prevent_thread_lock=True,
        show_error=True,
        max_file_size=config.max_upload,
        allowed_paths=[str(EXAMPLES)],
        blocked_paths=[
            str(path) for path in (config.weights, config.body, config.private_folder) if path
        ],
        run_history=False,
        ssr_mode=False,
        pwa=False,
        mcp_server=False,
        strict_cors=True,
        enable_monitoring=False,
        state_session_capacity=64,
        footer_links=["api"],
        theme=make_theme(),
        css_paths=[CSS],
        head=head_style(),
        quiet=True,
        # Before Gradio's own routes, and there as soon as anyone can ask.
        app_kwargs={"routes": routes},
    )
    # Only now: reading models beside it would hold up the page's own start.
    if is_warmed_up:
        arguments = (config, first_look)
        threading.Thread(target=_warm_up, args=arguments, name="warm-up", daemon=True).start()
    return page


def main(argv: list[str] | None = None) -> None:
    """Entry of ``python app.py``."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        config = parse_config(argv)
        page = launch(config)
    except Exception as error:
        sentence = str(error) if isinstance(error, OSError) else sentence_of(error)
        if sentence is None:
            raise
        sys.exit(f"app.py: {sentence}")
    sys.stderr.write(f"The page is open at {page.local_url}\n")
    page.block_thread()


def _generate(request, on_event, should_cancel):
    """The pipeline, imported at the first run or by the warm-up: the page itself needs no torch."""
    from app.run.pipeline import generate_all

    return generate_all(request, on_event, should_cancel)


def _warm_up(config: AppConfig, first_look: FirstLookDesk | None) -> None:
    """Load what the first visitor would otherwise wait for; a failure shows at the first run."""
    try:
        from app.run.models import warm_up

        warm_up(config.weights, config.body)
    except Exception:
        log.exception("the warm-up failed; the first run will say why")
        return
    if first_look is not None:
        first_look.make()
