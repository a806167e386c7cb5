"""Jerk that comes again: where windows join, or after any other number of frames."""

from conventions.rates import FPS
from model.faults.evidence import Evidence
from model.faults.finding import Finding

SEAM_CHANCE = 1e-3
"""Of `recurring_jerk`; clean: at least 0.0026 in 3,540 whole clips and stretches of 10 s."""


def seams(evidence: Evidence) -> list[Finding]:
    found = evidence.raw.seams.recurring_jerk
    advance = evidence.raw.seams.folded_on_frames
    if advance is None or found.phase_frame is None or found.chance > SEAM_CHANCE:
        return []
    joins = range(found.phase_frame, evidence.num_frames, advance)
    return [
        Finding(
            "seams",
            f"The body jumps every {advance} frames ({advance / FPS:.2f}"
            f" s), at frame {found.phase_frame} of each window: its jerk there is"
            f" {found.ratio:.1f} times the usual.",
            {
                "window_advance_frames": advance,
                "phase_frame": found.phase_frame,
                "jerk_ratio": found.ratio,
            },
            excess=found.ratio,
            worst_frame=joins[len(joins) // 2],
            stretches=tuple((frame, frame) for frame in joins[:20]),
        )
    ]


def period(evidence: Evidence) -> list[Finding]:
    """Jerk that comes again after another number of frames than the windows that are known."""
    measured = evidence.raw.seams
    found, windows = measured.period, measured.folded_on_frames
    if found is None or (windows != found.frames and windows and found.frames % windows == 0):
        return []
    if windows == found.frames and seams(evidence):
        return []
    verb = "jerk" if found.part == "legs" else "jerks"
    if found.kind == "pulses":
        how = f"{found.peak_over_usual:.1f} times the usual at frame {found.phase_frame} of each"
    else:
        how = f"{found.peak_over_least:.1f} times as high at one of them as at another"
    return [
        Finding(
            "period",
            f"The {found.part} {verb} anew every {found.frames} frames"
            f" ({found.frames / FPS:.2f} s): jerk is {how}, {found.periods} times over (by chance"
            f" once in {_one_in(found.chance)} clips).",
            {
                "period_frames": found.frames,
                "part": found.part,
                "phase_frame": found.phase_frame,
                "peak_over_usual": found.peak_over_usual,
                "peak_over_least": found.peak_over_least,
                "chance": found.chance,
            },
            excess=found.peak_over_usual,
            worst_frame=found.worst_frames[0],
            stretches=tuple((frame, frame) for frame in found.worst_frames),
        )
    ]


def _one_in(chance: float) -> str:
    number = 1 / max(chance, 1e-300)
    return "over a million" if number > 1e6 else f"{float(f'{number:.1g}'):,.0f}"
