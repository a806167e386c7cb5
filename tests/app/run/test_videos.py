"""Videos of runs and of a stage: what stands where, how large, how many at once, and how long."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.errors import Cancelled, RunError
from app.run.bodies import (
    FOOT_JOINT_HEIGHT_M,
    PointTracker,
    align_and_cap_lengths,
    align_average_to_origin,
    alignment_to_origin,
    body_motion,
)
from app.run.callbacks import NO_CALLBACKS, RunCallbacks, StageProgress
from app.run.display import (
    MAX_VIDEO_BODIES,
    Mode,
    ViewerBody,
    ViewerPanel,
    ViewerSettings,
    ViewerState,
)
from app.run.examples import CLEAN
from app.run.output.result_folder import ResultFolder
from app.run.pipeline import _draw_poses, _render_videos, _small
from app.run.requests.requests import ViewerVideoRequest
from app.run.videos import videos, viewer_recording
from app.run.videos.videos import (
    LEAST_FULL_SCALE,
    MEAN_JERK_RADIUS_FRAMES,
    choose_compared_motions,
    jerk_marks,
)
from app.run.videos.viewer_recording import NAME, draw_viewer_video
from conventions.joints import JOINT_INDEX
from conventions.names import REFERENCE_NAME
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion, save_motion
from model.motion.tracks import track_points
from model.speech.audio import write_wav
from renderer.body.body import load_body
from renderer.scene.camera_setup import make_camera_setup
from renderer.video.compose import label_band_height
from renderer.video.render import RenderSettings, camera_setup_for, draw_frames
from renderer.video.workers import MotionRenderJob
from tests.app.fakes import made_motion
from tests.app.requests import diagnose_request, generate_request
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform
from tests.renderer.video.test_encoder import decoded_frames

PANELS = (
    ViewerPanel(rect=(0, 0, 80, 100)),
    ViewerPanel(view="right_hand", rect=(0, 100, 40, 40)),
    ViewerPanel(view="left_hand", rect=(40, 100, 40, 40)),
)
BODIES = tuple(ViewerBody(label=label, motion_url="", color="#d55e00") for label in "abc")
GRID = ViewerState(
    bodies=BODIES, visible=(0, 1), picture_size=(80.0, 140.0), panels=(PANELS,), columns=2
)
BESIDE = ViewerPanel(rect=(40, 0, 80, 100)), ViewerPanel(view="right_hand", rect=(0, 0, 40, 100))


def changed(seen: ViewerState, **changes: Any) -> ViewerState:
    """Another, of which some is another way; of its look, too."""
    settings = {
        name: changes.pop(name) for name in list(changes) if name in ViewerSettings.model_fields
    }
    return seen.model_copy(
        update={"settings": seen.settings.model_copy(update=settings), **changes}
    )


PAIR = changed(
    GRID,
    picture_size=(160.0, 100.0),
    panels=(
        BESIDE,
        (BESIDE[0], ViewerPanel(view="right_hand", rect=(120, 0, 40, 100))),
    ),
    mode="wipe",
)


def moved(motion: Motion, degrees: float) -> Motion:
    """Somewhere else, and turned about the vertical."""
    turn = Rotation.from_euler("y", degrees, degrees=True)
    rest = open_body_skeleton().rest_joints[0].double().numpy()
    poses = motion.poses.reshape(len(motion.poses), -1, 3).copy()
    poses[:, 0] = (turn * Rotation.from_rotvec(poses[:, 0])).as_rotvec()
    trans = turn.apply(motion.trans + rest) - rest + (3.0, 0.4, -2.0)
    return replace(motion, poses=poses.reshape(len(poses), -1), trans=trans.astype(np.float32))


def test_motions_of_other_places_are_laid_onto_each_other() -> None:
    for degrees in [0.0, 90.0, -170.0]:
        motion = load_motion(CLEAN).part(slice(60))
        elsewhere = moved(motion, degrees)
        skeleton = open_body_skeleton()
        own = track_points(align_average_to_origin(motion), skeleton).joints
        theirs = track_points(align_average_to_origin(elsewhere), skeleton).joints
        np.testing.assert_allclose(theirs, own, atol=1e-4)
        across = own[:, JOINT_INDEX["left_hip"]] - own[:, JOINT_INDEX["right_hip"]]
        assert abs(across[:, 2].mean()) < 1e-4 < across[:, 0].mean()
        np.testing.assert_allclose(np.median(own[:, 0], axis=0)[[0, 2]], 0.0, atol=1e-5)
        feet = own[:, [JOINT_INDEX["left_foot"], JOINT_INDEX["right_foot"]], 1].min(axis=1)
        assert np.median(feet) == pytest.approx(FOOT_JOINT_HEIGHT_M, abs=1e-5)
        again = alignment_to_origin(
            align_average_to_origin(elsewhere)
        )  # what a player is told has been done
        assert again.yaw_rad == pytest.approx(0, abs=1e-4)
        assert again.translation_m == pytest.approx((0, 0, 0), abs=1e-4)


def test_only_what_can_be_drawn_in_time_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.run.bodies.MAX_FRAMES", 60)
    motion = load_motion(CLEAN)
    pictured, notes = align_and_cap_lengths({"long": motion, "short": motion.part(slice(20))})
    assert [each.num_frames for each in pictured.values()] == [30, 20]
    assert notes == ("The viewer and the videos show only the first 1 s of long.",)


class _Drawing(Exception):
    """Begins now."""


def test_all_bodies_of_a_run_are_in_register(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A reference that was recorded elsewhere stands where the systems stand, as large as they."""
    jobs: dict[Any, Any] = {}

    def begin(given: dict[Any, Any], **others: Any) -> None:
        jobs.clear()
        jobs.update(given)
        raise _Drawing

    monkeypatch.setattr(videos, "run_render_jobs", begin)
    body = load_body()
    motion = load_motion(CLEAN).part(slice(40))
    elsewhere = moved(motion, 120.0)
    tracker = PointTracker()
    asked = generate_request(
        speech=tmp_path / "s.wav", out=tmp_path / "out", views=("front", "side"), has_video=True
    )
    staged = {"a": motion, REFERENCE_NAME: elsewhere}
    rows: Any = SimpleNamespace(
        viewer_motions=staged,
        body=body,
        audio_path=tmp_path / "s.wav",
        tracker=tracker,
        align=align_average_to_origin,
    )
    run: Any = RunCallbacks()
    with pytest.raises(_Drawing), ResultFolder(tmp_path / "out") as folder:
        run.folder, run.add_files = folder, None
        _render_videos(asked, rows, run)
    mine, theirs = (
        body.joint_positions(jobs[name, "front"].motion) for name in ("a", REFERENCE_NAME)
    )
    np.testing.assert_allclose(theirs, mine, atol=1e-4)
    assert np.abs(np.median(mine[:, 0, [0, 2]], axis=0)).max() < 1e-4
    assert jobs["a", "front"].stage == jobs[REFERENCE_NAME, "front"].stage
    files = {job.out.name for job in jobs.values()}
    assert files == {f"{n}{v}.mp4" for n in ("a", REFERENCE_NAME) for v in ("", ".side")}


@pytest.mark.gl
def test_snapshots_are_those_of_each_motion_alone_before_the_camera_of_all(tmp_path: Path) -> None:
    """Also where the camera goes with them, and where one has another shape and face."""
    motion = load_motion(CLEAN).part(slice(40))
    walking = replace(motion, trans=motion.trans + np.linspace(0, 3, 40)[:, None] * [1, 0, 0])
    other = replace(motion, betas=np.ones(300, np.float32), expression_basis="flame100")
    drawn = {"a": motion, "b": walking, "c": other}
    body = load_body()
    asked = diagnose_request(motions=(), out=tmp_path, figure_frames=(3, 30))
    rows: Any = SimpleNamespace(figure_motions=drawn, body=body, align=lambda motion: motion)
    shares: list[Any] = []
    snapshots = _draw_poses(asked, rows, _small(asked.video), RunCallbacks(shares.append))
    assert [*snapshots.pictures] == [*drawn] and shares[-1].fraction == pytest.approx(0.6)
    settings = RenderSettings(512, 512)
    stage = camera_setup_for(body, [*map(body_motion, drawn.values())], settings)
    for name, each in drawn.items():
        alone = draw_frames(body, body_motion(each), settings, stage, frames=(3, 30))
        np.testing.assert_array_equal(snapshots.pictures[name], [*map(np.copy, alone)])


def test_the_shaken_joint_stands_out_where_it_is_shaken() -> None:
    smooth, shaken = (body_motion(smooth_motion_example(90)) for _ in range(2))
    elbow, wrist = JOINT_INDEX["right_elbow"], JOINT_INDEX["right_wrist"]
    rng = np.random.default_rng(0)
    shaken.poses[60:, 3 * elbow : 3 * elbow + 3] += rng.normal(scale=0.1, size=(30, 3))
    motions = {"smooth": smooth, "shaken": shaken}
    body, settings = load_body(), RenderSettings(128, 128)
    stage = make_camera_setup(body, list(motions.values()))

    marks = jerk_marks(body, motions, (0, 40, 75), settings, stage)

    values = marks.joint_jerk
    assert values["shaken"].shape == (3, 55) and marks.pixels["shaken"].shape == (3, 55, 2)
    assert 40 + MEAN_JERK_RADIUS_FRAMES < 60
    np.testing.assert_allclose(values["shaken"][:2], values["smooth"][:2], rtol=1e-3, atol=0.5)
    assert values["shaken"][2, wrist] > 5 * values["smooth"][2, wrist]
    assert values["shaken"][2, elbow] < 2 * values["smooth"][2, elbow]  # it turns, and stays
    assert marks.full_scale >= values["shaken"][2, wrist] > LEAST_FULL_SCALE


def test_a_smooth_motion_has_no_strong_mark_and_one_frame_none() -> None:
    body, settings = load_body(), RenderSettings(128, 128)
    calm = body_motion(smooth_motion_example(60))
    calm.poses[:] *= 0.3
    motions = {"a": calm}
    stage = make_camera_setup(body, list(motions.values()))
    marks = jerk_marks(body, motions, (0, 50), settings, stage)
    assert marks.full_scale == LEAST_FULL_SCALE
    assert marks.joint_jerk["a"].max() < 0.5 * LEAST_FULL_SCALE

    one = {"a": body_motion(smooth_motion_example(1))}
    assert not jerk_marks(body, one, (0,), settings, stage).joint_jerk["a"].any()


def test_what_a_stage_shows_is_taken():
    changed(GRID, visible=(0, 2)).check()
    changed(GRID, mode="ghost", panels=(PANELS, PANELS[:1])).check()


def test_what_no_stage_shows_is_refused() -> None:
    many = 20 * BODIES[:1]
    body, right = PANELS[:2]
    thin = ViewerPanel(view="right_hand", rect=(0, 100, 40, 1))
    for changes, words in [
        ({"bodies": ()}, "no body in the viewer yet"),
        ({"mode": "wipe"}, "views do not match the bodies"),
        (
            {"mode": "ghost", "visible": (0,), "panels": (PANELS, PANELS)},
            "views do not match the bodies",
        ),
        (
            {"bodies": many, "visible": tuple(range(MAX_VIDEO_BODIES + 1))},
            "1 to 12 bodies; the viewer shows 13",
        ),
        ({"visible": ()}, "the viewer shows 0"),
        ({"visible": (0, 3)}, "views do not match the bodies"),
        ({"visible": (-1,)}, "greater than or equal to 0"),
        ({"picture_size": (10.0, 420.0)}, "greater than or equal to 64"),
        ({"panels": (PANELS, PANELS)}, "views do not match the bodies"),
        ({"panels": (PANELS[1:],)}, "views do not match the bodies"),
        ({"panels": ((body, right, right),)}, "views do not match the bodies"),
        ({"panels": ((ViewerPanel(rect=(0, 0, 900, 100)),),)}, "The body does not fit"),
        ({"panels": ((body, thin),)}, "right hand does not fit"),
        ({"exaggeration": 50.0}, "factor must be from 1 to 20; got 50"),
        ({"tone": "green"}, "'light', 'medium', 'dark' or 'clay'"),
        ({"camera": (0.0, 0.0, 99.0, 0.0, 0.0)}, "zoom must be from 0.4 to 10; got 99"),
    ]:
        with pytest.raises(RunError, match=words):
            ViewerState.parse(
                changed(GRID, **changes).model_dump_json(by_alias=True, warnings=False)
            )


def with_arms_down(num_frames: int = 1) -> Motion:
    motion = made_motion(num_frames, 0.01)
    for side, sign in (("left", -1), ("right", 1)):
        motion.poses[:, 3 * JOINT_INDEX[f"{side}_shoulder"] + 2] = sign * 1.2
    return motion


def asked(
    tmp_path: Path, seen: ViewerState, *motions: Motion, speech: Path | None = None
) -> ViewerVideoRequest:
    paths = []
    for i, motion in enumerate(motions or (with_arms_down(), with_arms_down())):
        paths.append(tmp_path / f"{i}.npz")
        save_motion(motion, paths[-1])
    return ViewerVideoRequest(
        viewer=seen, motions=tuple(paths), out=tmp_path / "out", speech=speech
    )


def drawn(request: ViewerVideoRequest) -> np.ndarray:
    """The pictures under the band with the names."""
    video = draw_viewer_video(request, NO_CALLBACKS)
    assert video.path == request.out / NAME and list(request.out.iterdir()) == [video.path]
    frames = decoded_frames(video.path)
    assert len(frames) == video.num_frames
    room = viewer_recording._VideoLayout.of(request.viewer)
    high = room.height
    wide = room.width if request.viewer.mode == "grid" else room.width // 2
    assert high - 2 <= frames.shape[1] - label_band_height(min(wide, high)) <= high + 2
    return frames[:, -high:].astype(int)


def dark(picture: np.ndarray) -> np.ndarray:
    """Where the suit is."""
    return picture.sum(axis=-1) < 400


@pytest.mark.gl
def test_bodies_stand_beside_each_other_with_their_hands_and_the_sound(tmp_path: Path) -> None:
    speech = tmp_path / "speech.wav"
    write_wav(speech, made_waveform(3200))
    frames = drawn(asked(tmp_path, GRID, speech=speech))
    _, height, width, _ = frames.shape
    assert width / height == pytest.approx(160 / 140, rel=0.03)
    half = dark(frames[0])[: round(height * 100 / 140)]
    left, right = half[:, : width // 2], half[:, width // 2 :]
    assert left.mean() > 0.03 and np.mean(left != right) < 0.01, "one motion, one picture"
    with av.open(str(tmp_path / "out" / NAME)) as file:
        assert file.streams.audio


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("mode", ["ghost", "wipe", "flicker"])
def test_a_pair_stands_pelvis_on_pelvis(tmp_path: Path, mode: Mode) -> None:
    first, second = with_arms_down(20), with_arms_down(20)
    second.trans[10:, 0] += 0.8  # in register it stands 0.4 m to one side, then to the other
    seen = changed(PAIR, mode=mode)
    frames, alone, apart = (
        drawn(asked(tmp_path, each, first, second))
        for each in (seen, changed(seen, visible=(0, 0)), changed(seen, is_pair_aligned=False))
    )
    wide = frames.shape[2]
    middle, beside = np.s_[:, :, wide // 4 : 3 * wide // 4], np.s_[:, :, 3 * wide // 4 + 4 :]
    moved = np.abs(frames[[2, 17]][beside] - apart[[2, 17]][beside]).mean()
    assert moved < 5, "hands stay in place, but for the shadow"
    away, free = (np.abs(each[middle] - alone[middle]).mean() for each in (frames, apart))
    assert away < 0.5 * free


def test_the_second_of_a_pair_stands_where_the_first_is_drawn() -> None:
    first, second = with_arms_down(6), with_arms_down(9)
    second.trans[:, 0] = np.arange(9)
    jobs = [MotionRenderJob(body_motion(motion)) for motion in (first, second)]
    laid = viewer_recording._laid_on(*jobs, jobs[1].motion)[0].motion.trans
    assert np.allclose(laid[:, [0, 2]], first.trans[0, [0, 2]]), "also where the first has ended"
    assert np.array_equal(laid[:, 1], second.trans[:, 1]), "but not in height"


def test_pictures_are_as_large_as_a_screen_has_room_for_but_small_ones_half_as_large_again() -> (
    None
):
    for size, columns, count in [
        ((320.0, 476.0), 5, 5),
        ((1200.0, 900.0), 1, 1),
        ((250.0, 500.0), 6, 12),
    ]:
        panels = ((ViewerPanel(rect=(0, 0, *size)),),)
        shown = {"visible": tuple(range(count)), "columns": columns}
        room = viewer_recording._VideoLayout.of(
            changed(GRID, picture_size=size, panels=panels, **shown)
        )
        assert room.width % 2 == room.height % 2 == 0
        assert room.width / room.height == pytest.approx(size[0] / size[1], rel=0.02)
        rows, band = -(-count // columns), label_band_height(min(room.width, room.height))
        wide, tall = columns * room.width, rows * (room.height + band)
        assert wide <= 1920 + 2 * columns and tall <= 1080 + 2 * rows
        assert wide > 1800 or tall > 980
        small = viewer_recording._VideoLayout.of(GRID)
        assert (small.width, small.height) == (120, 210)


def test_a_long_video_is_cut_and_says_so() -> None:
    zeros = np.zeros((6000, 165), np.float32)
    long = Motion(zeros, zeros[:, :3], zeros[:, :100], "flame100", np.zeros(300, np.float32))
    assert viewer_recording._longest([made_motion(2), made_motion(2)], GRID) == (2, ())
    limit, (note,) = viewer_recording._longest([made_motion(1), long], GRID)
    assert limit == 5400 and "first 180 s" in note


def test_too_small_bodies_are_refused_and_drawing_stops_when_it_is_told_to(tmp_path: Path) -> None:
    face = ViewerPanel(view="face", rect=(0, 10, 1000, 990))
    panels = ((ViewerPanel(rect=(0, 0, 10, 10)), face),)
    seen = changed(GRID, picture_size=(1000.0, 1000.0), panels=panels)
    with pytest.raises(RunError, match="cannot be recorded at this size"):
        draw_viewer_video(asked(tmp_path, seen), NO_CALLBACKS)
    told: list[object] = []
    with pytest.raises(Cancelled):
        draw_viewer_video(asked(tmp_path, GRID), RunCallbacks(told.append, lambda: bool(told)))
    assert told == [StageProgress("video", 0.0)] and not (tmp_path / "out" / NAME).exists()


def test_of_more_than_fit_the_first_sample_of_each_and_the_reference_stand_side_by_side() -> None:
    for number in (1, 5, 6, 8):
        names = [f"system{i}" for i in range(number)]
        fitting, told = choose_compared_motions([*names, "reference"])
        assert fitting == [*names[:5], "reference"]
        assert ("show only system0, system1, " in " ".join(told)) == (number > 5)
    names = [f"{name}{sample}" for name in ("a/b", "a/c") for sample in ("", ".s2", ".s3", ".s4")]
    assert choose_compared_motions(names)[0] == ["a/b", "a/c"]
