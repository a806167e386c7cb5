"""Decoding of sound files to 16 kHz mono by ffmpeg in a child process, streamed through a pipe.

Uploaded files are hostile: ffmpeg opens only that one file, accepts sound containers only (no
playlists), runs without a shell, and is killed when it takes too long or returns too much. Memory
holds the mono result and one block; librosa would hold the whole file at its original rate.
"""

import io
import re
import struct
import subprocess
import threading
import wave
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO

import imageio_ffmpeg
import numpy as np
from jaxtyping import Float, Float32, Float64

from conventions.names import pluralise, printable
from conventions.rates import FPS, SAMPLE_RATE
from model.motion.runs import true_runs
from model.storage.files import file_sha256, write_atomically

SILENCE_PEAK = 1e-3
"""Peak, relative to full scale (-60 dB), below which a file counts as silent."""
CANCELLATION_LEVEL = 0.25
"""Level of the mix of all channels, relative to the loudest channel, below which the loudest
channel alone is used."""

_CONTAINERS = (
    "wav,w64,aiff,au,caf,flac,ogg,mp3,aac,mov,matroska,amr,asf,wv,avi,mpegts,mpeg,nistsphere,voc,"
    "tta,ac3,eac3"
)
MIN_TIMESTAMP_GAP_S = 0.1
"""Shortest gap between a file's time stamps (s) that is filled with silence."""
_LATE = "The sound starts {seconds:.1f} s after the start of the file; silence was added before it."
_RESAMPLE = f"aresample={SAMPLE_RATE}:osf=flt"
_FILL_GAPS = f"{_RESAMPLE},aresample=async=1:min_comp={MIN_TIMESTAMP_GAP_S}:first_pts=0"
"""ffmpeg filter that places samples by their time stamps. It follows the resampling, so that a gap
takes no more memory in ffmpeg than in the result."""
_MAX_TRACKS = 8
"""Number of sound tracks that are searched for one that is not silent."""
_BLOCK_BYTES = 1 << 20
_LOG_BYTES = 1 << 16
_TIMEOUT_S = 300
_READABLE = "give a WAV, FLAC, OGG, MP3, M4A or WebM file"


class SpeechError(ValueError):
    """A sound file that cannot be used; the message is one sentence for the user."""


@dataclass(frozen=True)
class SpeechReadOptions:
    """Limits on sound files, and the choice of channel."""

    min_s: float | int = 0.5
    max_s: float | int = 600
    max_bytes: int = 2 * 2**30
    channel: int | None = None
    """Channel that is used, counted from 0; None mixes all."""


@dataclass(frozen=True, eq=False)
class Speech:
    """Speech as a waveform, with the source file's digest and notes on how it was read."""

    waveform: Float32[np.ndarray, " N"]
    """Waveform (N,) at 16 kHz, mono, full scale 1."""
    sha256: str
    """SHA-256 of the source file's bytes."""
    notes: tuple[str, ...] = ()
    """Sentences for the user, such as what was missing from the file."""
    track: int = 0
    """Number of the sound track in the file, from 0."""

    @property
    def duration_s(self) -> float:
        return len(self.waveform) / SAMPLE_RATE

    @property
    def num_motion_frames(self) -> int:
        """Number of motion frames during the speech."""
        return round(FPS * self.duration_s)


@dataclass(frozen=True, eq=False)
class _Decoded:
    waveform: Float32[np.ndarray, " N"]
    channel_rms: Float64[np.ndarray, " C"]
    rate: int | None
    """Sample rate of the file (Hz), if ffmpeg prints one."""
    declared_s: float | None
    """Duration of the sound in the file's header (s), if there is one."""
    num_tracks: int
    """Number of sound tracks in the file."""
    notes: tuple[str, ...] = ()
    """Sentences about the file's time stamps."""


def load_speech(path: str | Path, options: SpeechReadOptions = SpeechReadOptions()) -> Speech:
    """Load a sound file of any common format, or a sound track of a video.

    Channels are mixed to one; if they cancel each other, the loudest alone is used. Of several
    tracks the first that is not silent is used. Where the file's time stamps show a late start or
    gaps, these are filled with silence. ``notes`` lists what was changed or missing. Raises
    SpeechError if the file is missing, is not a sound file, is too short, too long, too large,
    silent, or holds values that are not finite; one sentence with the file's name.
    """
    path = Path(path)
    name = printable(path.name)[:100]
    digest = _checked_sha256(path, name, options)
    decoded, track, notes = _first_audible_track(path, name, options)
    num_channels = len(decoded.channel_rms)
    if options.channel is not None:
        if options.channel >= num_channels > 0:
            raise SpeechError(
                f"{name} has {pluralise(num_channels, 'channel')}, but channel "
                f"{options.channel + 1} was requested."
            )
        if num_channels > 1:
            notes.append(f"Only channel {options.channel + 1} of {num_channels} was used.")
    elif num_channels > 1:
        notes.append(f"The file has {num_channels} channels; they were mixed to one.")
        loudest = int(decoded.channel_rms.argmax())
        if _rms(decoded.waveform) < CANCELLATION_LEVEL * decoded.channel_rms[loudest]:
            decoded = _decode(path, name, options, loudest, track)
            notes[-1] = (
                f"The file has {num_channels} channels that nearly cancel each other when mixed; "
                f"only channel {loudest + 1}, the loudest, was used."
            )
    if decoded.rate not in (None, SAMPLE_RATE):
        notes.append(f"The sound was resampled from {decoded.rate:,} Hz to {SAMPLE_RATE:,} Hz.")
    notes += decoded.notes
    waveform = decoded.waveform
    _check_waveform(waveform, name, options)
    missing_s = (decoded.declared_s or 0.0) - len(waveform) / SAMPLE_RATE
    if missing_s > max(0.1, 0.01 * (decoded.declared_s or 0.0)):
        notes.append(
            f"Only {len(waveform) / SAMPLE_RATE:.1f} s could be read of the "
            f"{decoded.declared_s:.1f} s that the file states; the file is damaged or cut off."
        )
    peak = float(np.abs(waveform).max())
    if peak > 1:
        waveform = waveform / np.float32(peak)
        if peak > 2:
            notes.append(
                f"The samples reached {peak:.3g} times full scale; they were scaled down to fit."
            )
    return Speech(waveform=waveform, sha256=digest, notes=tuple(notes), track=track)


def _first_audible_track(
    path: Path, name: str, options: SpeechReadOptions
) -> tuple[_Decoded, int, list[str]]:
    """Return the first track that is not silent (else the first), its number, and notes."""
    first = _decode(path, name, options, options.channel)
    if first.num_tracks < 2:
        return first, 0, []
    for track in range(min(first.num_tracks, _MAX_TRACKS)):
        decoded = first if track == 0 else _decode(path, name, options, options.channel, track)
        if np.abs(decoded.waveform).max(initial=0.0) >= SILENCE_PEAK:
            why = ", the first that is not silent," if track else ""
            note = f"Sound track {track + 1} of {first.num_tracks}{why} was used."
            return decoded, track, [note]
    return first, 0, []


def write_wav(path: str | Path, waveform: Float[np.ndarray, " N"]) -> None:
    """Write 16-bit PCM, 16 kHz mono; values beyond full scale are clipped; raises WriteError."""
    write_atomically(path, wav_bytes(waveform))


def wav_bytes(waveform: Float[np.ndarray, " N"]) -> bytes:
    """Return the bytes of a 16-bit PCM file, 16 kHz mono; values beyond full scale are clipped."""
    samples = np.rint(np.clip(waveform, -1, 1) * 32767).astype("<i2")
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as wav:
        wav.setnchannels(1)
        wav.setsampwidth(2)
        wav.setframerate(SAMPLE_RATE)
        wav.writeframes(samples.tobytes())
    return buffer.getvalue()


def _checked_sha256(path: Path, name: str, options: SpeechReadOptions) -> str:
    if not path.is_file():
        kind = "is a folder, not a sound file" if path.is_dir() else "does not exist"
        raise SpeechError(f"{name} {kind}; {_READABLE}.")
    try:
        size = path.stat().st_size
        if size == 0:
            raise SpeechError(f"{name} is empty (0 bytes); {_READABLE}.")
        if size > options.max_bytes:
            raise SpeechError(
                f"{name} is {size / 2**20:.0f} MiB; at most {options.max_bytes / 2**20:.0f} MiB "
                "are read. Save it as FLAC or MP3."
            )
        return file_sha256(path)
    except OSError as error:
        raise SpeechError(f"{name} could not be read: {error.strerror or error}.") from error


def _check_waveform(
    waveform: Float32[np.ndarray, " N"], name: str, options: SpeechReadOptions
) -> None:
    duration_s = len(waveform) / SAMPLE_RATE
    if len(waveform) == 0:
        raise SpeechError(f"{name} holds no sound (0 samples); {_READABLE} of speech.")
    if len(waveform) > _max_samples(options):
        raise _too_long(name, options)
    if duration_s < options.min_s:
        raise SpeechError(
            f"{name} is {duration_s:.2g} s long; at least {options.min_s:g} s are needed."
        )
    peak = float(np.abs(waveform).max())
    if peak < SILENCE_PEAK:
        level = f"{20 * np.log10(peak):.0f} dBFS" if peak > 0 else "zero"
        raise SpeechError(
            f"{name} is silent (its loudest sample is {level}); check the microphone or the file."
        )


def _decode(
    path: Path,
    name: str,
    options: SpeechReadOptions,
    channel: int | None,
    track: int = 0,
    filters: str = _FILL_GAPS,
) -> _Decoded:
    """Decode the file once; ``channel`` selects one channel, if it exists, instead of the mean."""
    try:
        ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise SpeechError(
            f"{name} cannot be decoded: no ffmpeg was found; install imageio-ffmpeg again."
        ) from error
    command = [
        *(ffmpeg, "-hide_banner", "-nostdin", "-nostats", "-loglevel", "repeat+level+verbose"),
        *("-threads", "1", "-max_alloc", str(2**28)),
        *("-protocol_whitelist", "file", "-format_whitelist", _CONTAINERS),
        *("-i", f"file:{path.resolve()}"),
        *("-map", f"0:a:{track}", "-vn", "-sn", "-dn", "-map_metadata", "-1", "-af", filters),
        # Sun's .au is raw samples after a header that says how many channels there are.
        *("-t", f"{options.max_s + 1:.3f}", "-ar", str(SAMPLE_RATE)),
        *("-c:a", "pcm_f32be", "-f", "au", "pipe:1"),
    ]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None and process.stderr is not None
    log, repairs = bytearray(), _TimestampRepairs()
    log_reader = threading.Thread(target=_drain, args=(process.stderr, log, repairs), daemon=True)
    log_reader.start()
    timed_out = threading.Event()
    watchdog = threading.Timer(_TIMEOUT_S, lambda: (timed_out.set(), process.kill()))
    watchdog.daemon = True
    watchdog.start()
    try:
        waveform, channel_rms = _read_au(process.stdout, name, options, channel)
    finally:
        watchdog.cancel()
        process.kill()
        process.wait()
        log_reader.join()
        process.stdout.close()
        process.stderr.close()
    if timed_out.is_set():
        raise SpeechError(
            f"{name} took longer than {_TIMEOUT_S} s to decode; save it as WAV and try again."
        )
    text = log.decode("utf-8", "replace")
    rate, declared_s, num_tracks = _parse_log(text, track)
    if rate is None and len(waveform) == 0:
        raise SpeechError(f"{name} is not a sound file that can be read; {_READABLE}.")
    if repairs.num_dropped > sum(repairs.gap_lengths):
        whole = _decode(path, name, options, channel, track, _RESAMPLE)
        note = (
            f"According to the file's time stamps, {repairs.num_dropped / SAMPLE_RATE:.1f} s of "
            "sound overlap; the time stamps were ignored, and all sound was kept."
        )
        return replace(whole, notes=(note,))
    waveform, notes = _with_late_start(waveform, text, track, options.max_s)
    notes += _gap_notes(waveform, repairs.gap_lengths)
    return _Decoded(waveform, channel_rms, rate, declared_s, num_tracks, tuple(notes))


def _read_au(
    stream: IO[bytes], name: str, options: SpeechReadOptions, channel: int | None
) -> tuple[Float32[np.ndarray, " N"], Float64[np.ndarray, " C"]]:
    """Return the mono samples and the RMS level of each channel, read block by block."""
    header = stream.read(24)
    if len(header) < 24:
        return np.zeros(0, dtype=np.float32), np.zeros(0)
    _, offset, _, _, _, num_channels = struct.unpack(">4s5I", header)
    stream.read(offset - len(header))
    frame_bytes = 4 * num_channels
    block_bytes = max(1, _BLOCK_BYTES // frame_bytes) * frame_bytes
    max_samples = _max_samples(options)
    blocks: list[np.ndarray] = []
    energy = np.zeros(num_channels)
    num_samples = 0
    while data := stream.read(block_bytes):
        data = data[: len(data) // frame_bytes * frame_bytes]
        block = np.frombuffer(data, dtype=">f4").reshape(-1, num_channels).astype(np.float32)
        if not np.isfinite(block).all():
            bad = num_samples + int(np.argmin(np.isfinite(block).all(axis=1)))
            raise SpeechError(
                f"{name} holds samples that are not finite (NaN or infinite), the first at "
                f"{bad / SAMPLE_RATE:.2f} s; export it again as 16-bit WAV."
            )
        energy += np.square(block, dtype=np.float64).sum(axis=0)
        is_one = channel is not None and channel < num_channels
        blocks.append(block[:, channel].copy() if is_one else _mean(block))
        num_samples += len(block)
        if num_samples > max_samples:
            raise _too_long(name, options)
    waveform = np.concatenate(blocks) if blocks else np.zeros(0, dtype=np.float32)
    return waveform, np.sqrt(energy / max(1, num_samples))


def _max_samples(options: SpeechReadOptions) -> int:
    """Return the largest number of samples; decoders pad the end, so half a frame is tolerated."""
    return round((options.max_s + 0.5 / FPS) * SAMPLE_RATE)


def _too_long(name: str, options: SpeechReadOptions) -> SpeechError:
    return SpeechError(
        f"{name} is longer than the limit of {_minutes(options.max_s)}; cut it, or raise the limit "
        "(--max-minutes)."
    )


def _mean(block: Float32[np.ndarray, "N C"]) -> Float32[np.ndarray, " N"]:
    """Return the mean of all channels, summed in float64 because float32 could overflow."""
    return block.mean(axis=1, dtype=np.float64).astype(np.float32)


_LEVEL = re.compile(rb"\[(\w+)\] ")
_MOVED = re.compile(rb"(adding|discarding) (\d{1,12}) audio samples")
_STEP = 16384
"""Largest number of silent samples that ffmpeg adds at once; a longer gap has several messages."""


@dataclass
class _TimestampRepairs:
    """Changes that ffmpeg made to follow time stamps, in samples of the result."""

    gap_lengths: list[int] = field(default_factory=list)
    """Lengths of the gaps that were filled with silence, in their order."""
    num_dropped: int = 0
    """Number of samples dropped because their time had already passed."""
    is_last_gap_continued: bool = False
    """True if silence that follows continues the last gap."""


def _drain(stream: IO[bytes], log: bytearray, repairs: _TimestampRepairs) -> None:
    """Copy the start of ffmpeg's log and drop the rest, so that it never blocks.

    Of verbose messages only those about time stamps are used.
    """
    for line in iter(lambda: stream.readline(_LOG_BYTES), b""):
        level = _LEVEL.search(line)
        if level is None or level[1] != b"verbose":
            line = line if level is None else line[: level.start()] + line[level.end() :]
            log.extend(line[: max(0, _LOG_BYTES - len(log))])
        elif moved := _MOVED.search(line):
            count = int(moved[2])
            if moved[1] == b"discarding":
                repairs.num_dropped += count
            elif repairs.is_last_gap_continued:
                repairs.gap_lengths[-1] += count
            else:
                repairs.gap_lengths.append(count)
            repairs.is_last_gap_continued = moved[1] == b"adding" and count == _STEP


_LATE_FORMATS = re.compile(r"^Input #0, mpeg(?:ts)?,", re.MULTILINE)
"""Containers in which ffmpeg shifts the start of each track to 0 if the video is not decoded."""


def _with_late_start(
    waveform: Float32[np.ndarray, " N"], log: str, track: int, max_s: float | int
) -> tuple[Float32[np.ndarray, " M"], list[str]]:
    """Add the silence before a track that starts later than the file, if ffmpeg dropped it."""
    start = re.search(r"^  Duration: .*?, start: (\d+\.\d+)", log, re.MULTILINE)
    sounds = [stream for kind, stream in _STREAM.findall(log) if kind == "Audio"]
    own = re.search(r", start (\d+\.\d+)", sounds[track]) if track < len(sounds) else None
    late_s = float(own[1]) - float(start[1]) if start and own else 0.0
    if not _LATE_FORMATS.search(log) or not MIN_TIMESTAMP_GAP_S <= late_s <= max_s:
        return waveform, []
    return np.pad(waveform, (round(late_s * SAMPLE_RATE), 0)), [_LATE.format(seconds=late_s)]


def _gap_notes(waveform: Float32[np.ndarray, " N"], filled: Sequence[int]) -> list[str]:
    """Return notes on the silence that was filled in; its places are the stretches of zeros."""
    stretches = iter(true_runs(waveform == 0))
    gap_spans: list[tuple[float, float]] = []
    for count in filled:
        start = next((start for start, end in stretches if end - start >= count), len(waveform))
        gap_spans.append((start / SAMPLE_RATE, count / SAMPLE_RATE))
    notes = [_LATE.format(seconds=length) for start, length in gap_spans if start == 0]
    if gaps := [gap for gap in gap_spans if gap[0] > 0]:
        (first_s, length_s), total_s = gaps[0], sum(length for _, length in gaps)
        notes.append(
            f"According to the file's time stamps, the sound has {pluralise(len(gaps), 'gap')}, "
            f"{total_s:.1f} s in total, the first at {first_s:.1f} s; silence was filled in."
            if len(gaps) > 1
            else f"According to the file's time stamps, the sound has a gap of {length_s:.1f} s at "
            f"{first_s:.1f} s; silence was filled in."
        )
    return notes


_ERRORS = re.compile(r"^\[.*\b(?:Error|Invalid|partial file|truncat|corrupt)", re.M | re.I)
_STREAM = re.compile(r"^  Stream #0:\d+.*?: (Audio|Video): (.*(?:\n   .*)*)", re.MULTILINE)


def _parse_log(log: str, track: int) -> tuple[int | None, float | None, int]:
    """Parse the rate (Hz), stated duration (s) and number of sound tracks from ffmpeg's log.

    A duration estimated by ffmpeg is ignored, as is a video's, unless the log also reports damage.
    """
    source = log.split("\nOutput #0", 1)[0]
    streams = _STREAM.findall(source)
    sounds = [line for kind, line in streams if kind == "Audio"]
    has_video = any(kind == "Video" and "attached pic" not in line for kind, line in streams)
    own = sounds[track] if track < len(sounds) else ""
    rate = re.search(r"^.*?, (\d+) Hz", own)
    length = re.search(r"^ +DURATION +: (\d+):(\d\d):(\d\d\.\d+)", own, re.MULTILINE)
    is_whole_files = "Estimating duration from bitrate" not in source
    if length is None and is_whole_files and (not has_video or _ERRORS.search(log)):
        length = re.search(r"^  Duration: (\d+):(\d\d):(\d\d\.\d+)", source, re.MULTILINE)
    declared_s = None
    if length:
        hours, minutes, seconds = length.groups()
        declared_s = 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    return int(rate.group(1)) if rate else None, declared_s, len(sounds)


def _rms(waveform: Float32[np.ndarray, " N"]) -> float:
    return float(np.sqrt(np.mean(np.square(waveform, dtype=np.float64)))) if len(waveform) else 0.0


def _minutes(seconds: float | int) -> str:
    return f"{seconds / 60:g} minutes" if seconds >= 60 else f"{seconds:g} seconds"
