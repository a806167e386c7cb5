"""What a stage may ask a video of, and what is refused with a sentence."""

from dataclasses import replace

import pytest

from app.errors import RunError
from app.run.requests.display import Display
from app.run.videos.seen_video import BODY, MAX_BODIES, MAX_SHOWN, Mode, Seen, SeenPanel
from renderer.scene.camera import Orbit

PANELS = (
    SeenPanel(BODY, 0, 0, 240, 300),
    SeenPanel("right_hand", 0, 300, 120, 120),
    SeenPanel("left_hand", 120, 300, 120, 120),
)
SEEN = Seen(shown=(0, 2), size=(240.0, 420.0), panels=(PANELS,), columns=3)


def test_what_a_stage_shows_is_taken():
    SEEN.check(3)
    replace(SEEN, mode="ghost", panels=(PANELS, PANELS[:1])).check(3)


@pytest.mark.parametrize(
    ("changes", "num_bodies", "words"),
    [
        ({}, 0, "no body on the stage yet"),
        ({}, MAX_BODIES + 1, "at most 64 bodies; 65"),
        ({"mode": "magic"}, 3, "no way 'magic'"),
        ({"mode": "ghost", "shown": (0,)}, 3, "A ghost shows two bodies; 1"),
        ({"shown": tuple(range(MAX_SHOWN + 1))}, 20, "1 to 12 bodies; the stage shows 13"),
        ({"shown": ()}, 3, "the stage shows 0"),
        ({"shown": (0, 3)}, 3, r"bodies 0 to 2; got \[0, 3\]"),
        ({"shown": (-1,)}, 3, "bodies 0 to 2"),
        ({"columns": 0}, 3, "1 to 12 bodies; got 0"),
        ({"wipe": 1.5}, 3, "0 to 1 of the picture; got 1.5"),
        ({"size": (10.0, 420.0)}, 3, "64 to 8192 pixels on each side; the stage has 10 x 420"),
        ({"panels": (PANELS, PANELS)}, 3, "another number of pictures"),
        ({"panels": (PANELS[1:],)}, 3, "A picture holds a body"),
        ({"panels": ((PANELS[0], PANELS[1], PANELS[1]),)}, 3, "at most once each"),
        ({"panels": ((PANELS[0], replace(PANELS[1], view="attic")),)}, 3, "got body, attic"),
        ({"panels": ((replace(PANELS[0], width=900.0),),)}, 3, "The body has no room"),
        ({"panels": ((PANELS[0], replace(PANELS[1], height=2.0)),)}, 3, "right hand has no room"),
        ({"display": Display(exaggeration=50)}, 3, "1 to 20 times as large; got 50"),
        ({"camera": Orbit(zoom=99.0)}, 3, "zoom is 0.4 to 10; got 99"),
    ],
)
def test_what_no_stage_shows_is_refused(changes, num_bodies: int, words: str):
    with pytest.raises(RunError, match=words):
        replace(SEEN, **changes).check(num_bodies)


@pytest.mark.parametrize("mode", ["ghost", "wipe", "flicker"])
def test_a_pair_has_a_picture_of_each(mode: Mode):
    with pytest.raises(RunError, match="another number of pictures"):
        replace(SEEN, mode=mode).check(3)
