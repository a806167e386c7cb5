"""Stored generation that is partly repeated after its condition has changed.

Windows with unchanged input stay bit-identical, but for the one after each changed stretch: it
blends from the new motion into the old within a window, so that the following ones can stay.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float, Shaped
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from model.generation.base import SpeechWindow, System, Window, fade_weights, num_windows
from model.generation.windows import (
    GenerateOptions,
    MotionAssembler,
    WindowChain,
    first_window_spec,
    single_threaded,
)
from model.motion.motion import Motion, concatenate
from model.motion.rotations import interpolate_rotations
from model.speech.audio import Speech
from model.storage.files import written_atomically
from processes.job import Cancelled

OnPiece = Callable[[Motion], None]
CONDITION_TOLERANCE = 1e-3
"""Largest difference of features of an unchanged condition: soft edges of far events."""


class StateError(ValueError):
    """Error for a stored motion that no longer exists; the message is one sentence for the user."""


@dataclass(frozen=True, eq=False)
class GenerationState:
    """Motion of one sample, with all that is needed to change a part of it."""

    motion: Motion
    condition: Any
    changed_frames: tuple[range, ...]
    """Frames that differ from those of the version before; all frames of a first version,
    none of a restored state."""
    windows: tuple[Window, ...]
    """Windows before they are joined."""
    conditioning: Float[Tensor, "T input_dim"]
    constraint_state: Mapping[str, Tensor]
    """State of the constraint after the last frame, by name."""


def regenerate(
    system: System,
    speech: Speech,
    options: GenerateOptions,
    previous: GenerationState | None = None,
    should_cancel: Callable[[], bool] | None = None,
    on_piece: OnPiece = lambda motion: None,
) -> GenerationState:
    """Generate the motion of one sample and one condition as `generate_motion` does, and store it.

    Args:
        previous: the version with another condition; only what differs is generated again.

    Raises:
        UnknownNameError, ValueError: as `generate_motion`, or without one sample and condition.
        Cancelled: if ``should_cancel`` returns true.
    """
    if options.num_samples != 1 or len(options.conditions) != 1:
        raise ValueError(
            "Only one sample with one condition can be regenerated; got "
            f"{options.num_samples} samples and {len(options.conditions)} conditions."
        )
    if system.root_format != "place":
        raise ValueError(
            f"Motion of {system.name} cannot be regenerated: the system predicts the velocity of "
            "the body, not its position."
        )
    cut, spec = system.windowing, first_window_spec(system, options)
    former_followed = None if previous is None else previous.constraint_state
    constraint = system.make_constraint(options.conditions[0], former_followed)
    count = num_windows(speech.num_motion_frames, cut.frames, cut.overlap)
    with single_threaded():
        conditioning = system.conditioning(
            speech.waveform, cut.frames + (count - 1) * cut.advance, spec
        )
        chain = WindowChain(system, options)
        windows: list[Window] = []
        fresh: list[range] = []
        pieces: list[Motion] = []
        regenerated: MotionAssembler | None = None
        leads_here, left = False, speech.num_motion_frames
        for k in range(count):
            where = k * cut.advance, cut.frames, cut.context
            window = SpeechWindow.of(conditioning, *where)
            old = None if previous is None else previous.windows[k]
            is_same = previous is not None and _same(
                window, SpeechWindow.of(previous.conditioning, *where)
            )
            if old is not None and is_same and not leads_here:
                windows.append(old)
            else:
                if should_cancel is not None and should_cancel():
                    raise Cancelled
                new = chain.generate(window)
                leads_here = old is None or not is_same
                if old is None or leads_here:
                    windows.append(new)
                else:
                    windows.append(_blend_back(new, old, cut.advance))
                stop = (k + 1) * cut.advance
                if leads_here and k == count - 1:  # then the frames it shares with none are new
                    stop = speech.num_motion_frames
                fresh.append(range(k * cut.advance, min(stop, speech.num_motion_frames)))
            joined = chain.join(windows[-1])
            origin = (windows if previous is None else previous.windows)[0]
            regenerated = regenerated or MotionAssembler(system, origin.root[:, :1], constraint)
            length = min(left, joined.root.shape[1] if k == count - 1 else cut.advance)
            if length:  # a last window may hold only frames beyond the speech
                pieces += regenerated.next_motions(joined.part(slice(length)))
                left -= length
                on_piece(pieces[-1])
    motion = concatenate(pieces)
    followed = {} if constraint is None else constraint.state()
    (condition,) = options.conditions
    return GenerationState(
        motion, condition, tuple(_merge_ranges(fresh)), tuple(windows), conditioning, followed
    )


def _same(one: SpeechWindow, other: SpeechWindow) -> bool:
    return bool((one.features - other.features).abs().max() < CONDITION_TOLERANCE)


def _blend_back(new: Window, old: Window, advance: int) -> Window:
    """Blend a window from the new to the old one, which it equals where the next window starts."""
    weight = torch.ones(new.root.shape[1])
    weight[:advance] = fade_weights(advance)
    weight = weight.to(new.root)
    is_old = weight[:, None] == 1

    def faded(one: Float[Tensor, "T C"], other: Float[Tensor, "T C"]) -> Tensor:
        return torch.where(is_old, other, torch.lerp(one, other, weight[:, None]))

    rotmat = interpolate_rotations(new.rotmat, old.rotmat, weight[:, None])
    return replace(
        old,
        rotmat=torch.where(is_old[..., None, None], old.rotmat, rotmat),
        root=faded(new.root, old.root),
        expression=faded(new.expression, old.expression),
    )


def _merge_ranges(frames: Sequence[range]) -> list[range]:
    """Merge ranges that adjoin or overlap."""
    merged: list[range] = []
    for one in frames:
        if merged and merged[-1].stop >= one.start:
            merged[-1] = range(merged[-1].start, max(one.stop, merged[-1].stop))
        elif len(one):
            merged.append(one)
    return merged


STATE_SUFFIX = ".windows"
_CONDITIONING, _FOLLOWED = "heard", "followed."


def save_windows(state: GenerationState, path: Path) -> None:
    """Write the windows and their input features, bit-exact; the rest has separate files."""
    fields = [window.sliced_tensors(slice(None)) for window in state.windows]
    tensors = {name: torch.stack([each[name] for each in fields]) for name in fields[0]}
    with written_atomically(path) as part:
        followed = {_FOLLOWED + key: condition for key, condition in state.constraint_state.items()}
        conditioning = state.conditioning.contiguous()
        part.write_bytes(save({_CONDITIONING: conditioning, **followed, **tensors}))


def restore_state(path: Path, system: System, condition: Any, motion: Motion) -> GenerationState:
    """Restore the state that `save_windows` wrote; raises StateError if missing or damaged."""
    try:
        tensors = load(path.read_bytes())
        names = [name for name in tensors if name.startswith(_FOLLOWED)]
        followed = {name.removeprefix(_FOLLOWED): tensors.pop(name) for name in names}
        conditioning = tensors.pop(_CONDITIONING)
        return GenerationState(
            motion, condition, (), _windows(system, tensors), conditioning, followed
        )
    except (OSError, SafetensorError, KeyError, TypeError) as error:
        raise StateError("This version has expired. Generate the motion again.") from error


def _windows(system: System, tensors: Mapping[str, Shaped[Tensor, "windows ..."]]) -> tuple:
    count = len(next(iter(tensors.values())))
    return tuple(
        system.window_type(**{name: stacked[k] for name, stacked in tensors.items()})
        for k in range(count)
    )
