"""Motion of speech that is still being said."""

import numpy as np
import pytest
import torch

from model.generation.base import SpeechWindow
from model.generation.live import LiveGenerator, Pace
from model.generation.windows import GenerateOptions, MotionAssembler, WindowChain
from model.motion.motion import concatenate
from model.systems.globaldiff.config import PRIORFLOW

PACE = Pace(min_hop=10, look_ahead=12)
OPTIONS = GenerateOptions(speaker="ann", steps=2, seed=3)
FEATURES = torch.randn(400, 68, generator=torch.Generator().manual_seed(1))
SYSTEMS = ["globaldiff/local", "globaldiff/global", PRIORFLOW, "gan/5", "asynfusion/lcm-sync"]


def streamed(live: LiveGenerator, blocks):
    """All frames, in pieces as they became final."""
    pieces = []
    for block in blocks:
        live.add_features(block)
        while live.is_due:
            pieces += live.step()
    return pieces


def test_frames_are_final_ten_at_a_time_and_twelve_behind_the_speech(loaded):
    live = LiveGenerator(loaded("gan/5"), OPTIONS, PACE)
    live.add_features(FEATURES[:21])
    assert not live.is_due
    live.add_features(FEATURES[21:22])
    assert live.is_due and live.step()[0].num_frames == 10
    assert not live.is_due and live.next_frame == 10
    live.add_features(FEATURES[22:122])
    assert live.step()[0].num_frames == 52 and live.step()[0].num_frames == 48


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_stream_equals_windows_of_the_same_hops_and_draws(loaded, name):
    """Made apart from the stream: every window from all of the speech that was heard by then, so
    that nothing to come can have changed it."""
    system, num_frames, sizes = loaded(name), 120, [3, 14, 6] * 5 + [5]
    live = LiveGenerator(system, OPTIONS, Pace(min_hop=9, look_ahead=11))
    pieces = streamed(live, FEATURES[:num_frames].split(sizes))
    chain, motion = WindowChain(system, OPTIONS), MotionAssembler(system)
    cut, start, offline = system.windowing, 0, []
    for arrived in np.cumsum(sizes).tolist():
        hop = min(arrived - 11 - start, cut.advance)
        if hop < 9:
            continue
        held = FEATURES[:1].expand(50, -1)
        spoken = FEATURES[:arrived]
        all_speech = torch.cat([held, spoken, spoken.flip(0), held, held])
        first = 50 + start - cut.context
        speech = all_speech[first : first + cut.frames + 2 * cut.context]
        window = chain.generate_joined(SpeechWindow(speech), hop)
        offline += motion.next_motions(window.part(slice(hop)))
        start += hop
    assert len(pieces) == len(offline) > 6
    one, other = concatenate(pieces), concatenate(offline)
    for field in ("poses", "trans", "expressions"):
        np.testing.assert_allclose(getattr(one, field), getattr(other, field), atol=1e-5)


def test_memory_does_not_grow_and_place_does_not_drift(loaded):
    system = loaded(PRIORFLOW)
    live = LiveGenerator(system, OPTIONS, PACE)
    pieces = streamed(live, FEATURES.repeat(2, 1).split(52))
    assert len(live._speech) < 4 * 60 + 2 * 2 * system.windowing.context + 60 < 600
    assert system.root_format == "place"
    assert np.abs(concatenate(pieces).trans[:, [0, 2]]).max() < 3.0


@pytest.mark.parametrize("pace", [Pace(min_hop=7), Pace(min_hop=53), Pace(look_ahead=7)])
def test_a_pace_that_windows_cannot_keep_is_refused(loaded, pace):
    with pytest.raises(
        ValueError, match="gan/5 needs a hop of 8 to 52 frames and a look_ahead of at least 8"
    ):
        LiveGenerator(loaded("gan/5"), OPTIONS, pace)
