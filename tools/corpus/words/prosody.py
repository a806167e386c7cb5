"""Speech with words, phrases and accents, which are made audible in pitch and loudness."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from conventions.rates import SAMPLE_RATE
from model.plan.plan import SpanEvent
from tools.corpus.people.speaker import PAUSE, Phone, Speaker, synthesise, words_of
from tools.corpus.words.grammar import Split, generate_sentences

FUNCTION_WORDS = frozenset(
    """a an the and or but so of to in on at for from with by as is are was were be been am it its
    it's i you he she we they me him her us them my your his our their this that these those there
    then than if when while who which what do does did have has had will would can could should may
    might must not just like i'm you're that's there's i've we're don't didn't up out about into
    over um""".split()
)
STRONG_WORDS = frozenset(
    """really never always every all huge very so exactly best worst only most no big wow amazing
    whole stop crazy incredible nobody everybody completely tiny wonderful exaggerating""".split()
)
CONTRASTIVE_WORDS = frozenset("i you me we here there up down all this now".split())
"""Words that are accented now and then, as if contrasted with another one."""
CONTRASTIVE_SHARE = 0.25
LEAD_S = 0.5  # silence before the first word
MIN_ACCENT_GAP_S = 0.33
ACCENT_PITCH = 0.13  # playback speeds up by this share on an accent of 1
ACCENT_DB = 8.0
BETWEEN_ACCENTS_DB = -3.5
LISTENS, LISTENS_AFTER_A_QUESTION = 0.1, 0.6  # shares of sentences followed by listening
LISTENS_FIRST = 0.12  # share of clips that begin with listening
LISTENING_S = (2.5, 8.0)
MAX_PAUSE_S = 2.0  # longest pause of a speaker who continues


@dataclass(frozen=True)
class SpokenWord:
    """Word with its prominence ``accent`` (0 to about 1.3) and stressed vowel onset ``beat_s``."""

    text: str
    start_s: float
    end_s: float
    beat_s: float
    sentence: int
    accent: float = 0.0

    @property
    def is_content(self) -> bool:
        return self.text not in FUNCTION_WORDS


@dataclass(frozen=True)
class Phrase:
    """Words spoken in one breath, as a range of word numbers."""

    words: range
    start_s: float
    end_s: float
    ends_sentence: bool


@dataclass(frozen=True)
class Utterance:
    """Speech of one clip; the phones' ``word`` counts the words of the whole clip."""

    waveform: Float[np.ndarray, " N"]
    phones: tuple[Phone, ...]
    words: tuple[SpokenWord, ...]
    phrases: tuple[Phrase, ...]
    listening: tuple[SpanEvent, ...] = ()
    """Silences in which the speaker listens."""

    @property
    def duration_s(self) -> float:
        return len(self.waveform) / SAMPLE_RATE


def synthesise_utterance(
    speaker: Speaker,
    target_s: float,
    split: Split,
    text_rng: np.random.Generator,
    voice_rng: np.random.Generator,
) -> Utterance:
    """Speak sentences of the split until they last about ``target_s`` seconds."""
    lead_s = _draw_listening(voice_rng) if voice_rng.random() < LISTENS_FIRST else LEAD_S
    sentences: list[_Spoken] = []
    spoken_s = lead_s
    for text in generate_sentences(text_rng, split):
        if sentences and spoken_s >= target_s - 2.0:
            break
        waveform, phones = synthesise(text, speaker.voice, stretch=voice_rng.uniform(0.94, 1.06))
        pause_s = _draw_pause(text, speaker, voice_rng)
        sentences.append(_Spoken(text, *_trim(waveform, phones), pause_s))
        spoken_s += len(sentences[-1].waveform) / SAMPLE_RATE + pause_s
    return _with_accents(_join(sentences, lead_s), voice_rng)


@dataclass(frozen=True)
class _Spoken:
    """One sentence spoken by flite, and the silence after it."""

    text: str
    waveform: Float[np.ndarray, " N"]
    phones: list[Phone]
    pause_s: float


def _draw_pause(sentence: str, speaker: Speaker, rng: np.random.Generator) -> float:
    """Draw the silence (s) after a sentence, sometimes (after questions often) for listening."""
    share = LISTENS_AFTER_A_QUESTION if sentence.endswith("?") else LISTENS
    if rng.random() < share:
        return _draw_listening(rng)
    return float(np.clip(rng.gamma(3.5, 0.13) * speaker.pause, 0.18, MAX_PAUSE_S))


def _draw_listening(rng: np.random.Generator) -> float:
    """Draw the duration (s) of listening, more often short than long."""
    shortest_s, longest_s = LISTENING_S
    return float(shortest_s + (longest_s - shortest_s) * rng.beta(1.1, 1.9))


def _trim(
    waveform: Float[np.ndarray, " N"], phones: list[Phone]
) -> tuple[Float[np.ndarray, " M"], list[Phone]]:
    """Cut the silence at both ends; inner pauses stay."""
    first = next(k for k, p in enumerate(phones) if p.name != PAUSE)
    last = max(k for k, p in enumerate(phones) if p.name != PAUSE)
    start = max(phones[first].start_s - 0.03, 0.0)
    end = min(phones[last].end_s + 0.08, len(waveform) / SAMPLE_RATE)
    phones_left = [
        replace(p, start_s=p.start_s - start, end_s=p.end_s - start)
        for p in phones[first : last + 1]
    ]
    return waveform[int(start * SAMPLE_RATE) : int(end * SAMPLE_RATE)], phones_left


def _join(parts: list[_Spoken], lead_s: float) -> Utterance:
    """Join all sentences to one waveform, without phrases yet."""
    waves = [np.zeros(int(lead_s * SAMPLE_RATE))]
    phones: list[Phone] = []
    words: list[SpokenWord] = []
    for number, part in enumerate(parts):
        offset_s = sum(len(w) for w in waves) / SAMPLE_RATE
        moved = [
            replace(
                p,
                start_s=p.start_s + offset_s,
                end_s=p.end_s + offset_s,
                word=p.word + len(words) if p.word >= 0 else -1,
            )
            for p in part.phones
        ]
        first_word = len(words)
        for index, text in enumerate(words_of(part.text)):
            words.append(_word(text, number, first_word + index, moved))
        phones += moved
        waves += [part.waveform, np.zeros(int(part.pause_s * SAMPLE_RATE))]
    waveform = np.concatenate(waves)
    listening = _silences(phones, len(waveform) / SAMPLE_RATE)
    return Utterance(waveform, tuple(phones), tuple(words), (), listening)


def _silences(phones: list[Phone], duration_s: float) -> tuple[SpanEvent, ...]:
    """Return the silences that are long enough for listening."""
    sounded = [p for p in phones if p.name != PAUSE]
    starts = [0.0, *(p.end_s for p in sounded)]
    ends = [*(p.start_s for p in sounded), duration_s]
    return tuple(
        SpanEvent(start, end)
        for start, end in zip(starts, ends, strict=True)
        if end - start >= LISTENING_S[0]
    )


def _word(text: str, sentence: int, index: int, phones: list[Phone]) -> SpokenWord:
    """Return span and stressed vowel of a word; without phones it takes those of a neighbour."""
    sounded = [p for p in phones if p.name != PAUSE]
    own = [p for p in sounded if p.word == index]
    own = own or [min(sounded, key=lambda p: abs(p.word - index))]
    vowels = [p for p in own if p.is_vowel] or own
    stressed = next((p for p in vowels if p.stress), vowels[0])
    return SpokenWord(text, own[0].start_s, own[-1].end_s, stressed.start_s + 0.02, sentence)


def _with_accents(plain: Utterance, rng: np.random.Generator) -> Utterance:
    phrases = _find_phrases(plain.words)
    words = _place_accents(plain.words, phrases, rng)
    return _emphasise(replace(plain, words=words, phrases=phrases))


def _find_phrases(words: tuple[SpokenWord, ...]) -> tuple[Phrase, ...]:
    """Split at pauses over .12 s and at the ends of sentences."""
    starts = [0]
    for k in range(1, len(words)):
        before, after = words[k - 1], words[k]
        if after.start_s - before.end_s > 0.12 or before.sentence != after.sentence:
            starts.append(k)
    phrases = []
    for first, stop in zip(starts, [*starts[1:], len(words)], strict=True):
        is_last = stop == len(words) or words[stop].sentence != words[stop - 1].sentence
        span = range(first, stop)
        phrases.append(Phrase(span, words[first].start_s, words[stop - 1].end_s, is_last))
    return tuple(phrases)


def _place_accents(
    words: tuple[SpokenWord, ...], phrases: tuple[Phrase, ...], rng: np.random.Generator
) -> tuple[SpokenWord, ...]:
    """Assign prominence to a few words of every phrase, the last content word first."""
    result = list(words)
    for phrase in phrases:
        members = [
            k
            for k in phrase.words
            if words[k].is_content
            or words[k].text in STRONG_WORDS
            or (words[k].text in CONTRASTIVE_WORDS and rng.random() < CONTRASTIVE_SHARE)
        ] or [phrase.words[-1]]
        score = {
            k: 0.5
            + 0.35 * (k == members[-1])
            + 0.4 * (words[k].text in STRONG_WORDS)
            + 0.12 * min(len(words[k].text), 9) / 9
            + rng.normal(0, 0.18)
            for k in members
        }
        taken: list[float] = []
        for k in sorted(score, key=lambda member: score[member], reverse=True):
            beat = words[k].beat_s
            apart = all(abs(beat - other) > MIN_ACCENT_GAP_S for other in taken)
            if apart and score[k] > 0.4:
                taken.append(beat)
                result[k] = replace(words[k], accent=float(score[k]))
    return tuple(result)


def _emphasise(utterance: Utterance) -> Utterance:
    """Make accents audible: louder, and higher by a local speed-up that moves all later times."""
    num_samples = len(utterance.waveform)
    grid_s = np.arange(num_samples // 80 + 2) * 80 / SAMPLE_RATE
    level_db = np.full(len(grid_s), BETWEEN_ACCENTS_DB)
    speed = np.ones(len(grid_s))
    for word in utterance.words:
        if word.accent > 0:
            strength = min(word.accent, 1.2)
            near = np.exp(-0.5 * ((grid_s - word.beat_s - 0.06) / 0.07) ** 2)
            level_db += ACCENT_DB * strength * near
            speed += ACCENT_PITCH * strength * near
    new_s = np.concatenate([[0.0], np.cumsum(np.diff(grid_s) / (0.5 * (speed[1:] + speed[:-1])))])

    new_length = int(np.interp(num_samples / SAMPLE_RATE, grid_s, new_s) * SAMPLE_RATE)
    old_s = np.interp(np.arange(new_length) / SAMPLE_RATE, new_s, grid_s)
    waveform = map_coordinates(utterance.waveform, old_s[None] * SAMPLE_RATE, order=3)
    waveform *= 10 ** (np.interp(old_s, grid_s, level_db) / 20)
    waveform *= min(1.0, 0.98 / max(np.abs(waveform).max(), 1e-6))

    def moved(time_s: float) -> float:
        return float(np.interp(time_s, grid_s, new_s))

    return Utterance(
        waveform,
        tuple(replace(p, start_s=moved(p.start_s), end_s=moved(p.end_s)) for p in utterance.phones),
        tuple(
            replace(w, start_s=moved(w.start_s), end_s=moved(w.end_s), beat_s=moved(w.beat_s))
            for w in utterance.words
        ),
        tuple(
            replace(p, start_s=moved(p.start_s), end_s=moved(p.end_s)) for p in utterance.phrases
        ),
        tuple(SpanEvent(moved(s.start_s), moved(s.end_s)) for s in utterance.listening),
    )
