"""Every sentence a visitor of the page reads that is not made from a run's own numbers."""

TITLE = "Co-speech motion workbench"
TAGLINE = (
    "Speech in, SMPL-X motion out, from several models at once: same speech, same speaker, "
    "same noise. Watch them side by side and see where the jitter sits."
)
DEMO_WEIGHTS = (
    "These are <b>demonstration weights</b>, trained for this project on {data}. They are not "
    "the weights of the paper, and no number on this page is one of the paper's."
)
UNTRAINED = (
    "These weights are <b>random: nothing has been trained</b>. The motion means nothing; the page "
    "only shows that everything works."
)

MOTION_TAB = "Motion from speech"
STUDY_TAB = "User study"

STEP_SPEECH = "Speech"
STEP_SYSTEMS = "Systems"
STEP_SETTINGS = "Settings"

SPEECH_LABEL = "Speech"
SPEECH_HELP = "Upload or record {min_s:g} seconds to {max_min:g} minutes."
EXAMPLES_LABEL = "Or take an example (a synthetic voice)"
SYSTEMS_LABEL = "Systems to compare"
SYSTEMS_HELP = "Each is a trained generator; all get the same noise."
SPEAKER_LABEL = "Speaker style"
SEED_LABEL = "Seed"
SAMPLES_LABEL = "Samples per system"
SAMPLES_HELP = "More than one shows how much chance decides."
ADVANCED_LABEL = "Advanced"
STEPS_LABEL = "Sampler steps"
SAMPLER_LABEL = "Sampler"
SAMPLER_NAMES = {
    "heun": "Heun (second order)",
    "euler": "Euler (first order)",
    "reinterpolate": "Official re-interpolation",
}
FILTER_LABEL = "Smooth every system (Savitzky-Golay 7/2)"
FILTER_HELP = (
    "Off shows what the models made. On is what the official code does before anyone looks. "
    "The numbers always give both."
)
REFERENCE_LABEL = "Reference motion (BEAT2 .npz, optional)"
GENERATE = "Generate motion"
CANCEL = "Cancel"

EMPTY_TITLE = "Nothing generated yet"
EMPTY_STEPS = (
    ("Give it speech", "Upload, record, or take one of the examples."),
    ("Choose systems", "Local and global rotations are both on by default."),
    ("Press Generate motion", "Each video appears as soon as it is drawn; a ten-second clip "
     "takes well under a minute."),
)  # fmt: skip
VIDEOS_HEADING = "Each system"
COMPARISON_HEADING = "Side by side"
COMPARISON_HELP = "All in lock-step under one sound track."
FIGURE_HEADING = "Fingertip trajectory and poses"
FIGURE_HELP = (
    "Left: the right middle fingertip over up to 300 frames (10 s). Right: poses every 50 frames. "
    "A jagged line is jitter that the eye may miss in the video."
)
NUMBERS_HEADING = "Numbers"
NUMBERS_HELP = (
    "Measured on the right middle fingertip, as generated and after the Savitzky-Golay filter. "
    "Lower jerk is smoother, not better: real speech gestures are not still."
)
DOWNLOADS_HEADING = "Downloads"
ZIP_LABEL = "Everything as one zip"
FILES_LABEL = "Single files"

STAGE_NAMES = {
    "speech": "Read the speech",
    "motion": "Generate motion",
    "numbers": "Measure",
    "video": "Draw videos",
    "comparison": "Join side by side",
    "figure": "Draw the figure",
}
READY = "Ready."
STARTING = "Starting."
DRAWING = "being drawn"
PREVIEW_LABEL = "{name}: 3D preview, no sound"
WAITING = "Waiting: {ahead} ahead of you on this machine."
WAITING_ONE = "Waiting: one run ahead of you on this machine."
DONE = "Done in {seconds:.0f} s: {rows}, {frames} frames each at 30 per second."
STOPPED = "Stopped. Nothing was kept."
CANCELLED = "Cancelled. Nothing was kept."
FAILED_TITLE = "This run stopped"
NOTES_TITLE = "Good to know"

NO_SPEECH = "There is no speech yet: upload or record some, or take an example."
NO_SYSTEM = "No system is chosen: tick at least one."
BAD_SEED = "The seed must be a whole number from 0 to {limit}; got {value}."
TOO_MANY_VIDEOS = (
    "{systems} systems with {samples} samples are {count} videos; this page shows at most "
    "{limit}. Choose fewer."
)
BUSY = "This machine has {limit} runs waiting already; try again in a few minutes."
FAULT = (
    "Something went wrong inside the program, not with your input. Please report it with this "
    "number: {fault_id}."
)
NO_SYSTEMS_INSTALLED = "No trained systems were found in {folder}; start with --weights DIR."
