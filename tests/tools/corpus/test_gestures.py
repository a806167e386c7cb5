"""Gestures belong to what is said, stressed and contrasted; the people who make them differ."""

import numpy as np

from conventions.joints import JOINT_INDEX
from conventions.rates import SAMPLE_RATE
from tools.corpus.gesture.choice import (
    REPEAT_MEMORY,
    GestureSelector,
    contrast_halves,
    directions,
    list_items,
)
from tools.corpus.gesture.gestures import (
    GENERIC,
    GESTURES,
    GESTURES_BY_WORD,
    ONLY_WHEN_STRESSED,
    REST,
    SHAPES,
    finger_rotations,
)
from tools.corpus.gesture.plan import HandPlan, make_plan
from tools.corpus.gesture.speaker_style import BEAT_SHAPES, IDLE_SHAPES
from tools.corpus.people.rig import SIDES
from tools.corpus.people.speaker import SPEAKERS, words_of
from tools.corpus.words.prosody import Phrase, SpokenWord, Utterance

PEOPLE = {s.name: s for s in SPEAKERS}
ANNA = SPEAKERS[0]  # right-handed
CONTRAST = "Some people bake fresh bread, others would rather taste the sauce."
WORD_S = 0.5


def test_all_names_exist():
    for gesture in GESTURES.values():
        assert set(gesture.shapes) <= set(SHAPES)
    assert {name for names in GESTURES_BY_WORD.values() for name in names} <= set(GESTURES)
    assert set(GENERIC) <= set(GESTURES)
    assert set(ONLY_WHEN_STRESSED) <= set(GESTURES)
    assert {*IDLE_SHAPES, *BEAT_SHAPES} <= set(SHAPES)
    for speaker in SPEAKERS:
        assert speaker.beat_shape in SHAPES
        assert set(speaker.favourites) <= set(GENERIC)
        assert speaker.idle_shape in SHAPES
        assert {speaker.ready, *(speaker.rest_of(side) for side in SIDES)} <= set(REST)


def test_gestures_lie_in_front_within_reach():
    for name, gesture in GESTURES.items():
        for pose in (gesture.prepare, gesture.stroke, *(pose for _, pose in gesture.via)):
            out, up, forward = pose.position
            assert 0.04 < out < 0.40 and -0.40 < up < 0.30 and 0.05 < forward < 0.43, name
            assert abs(pose.flex_deg) < 60, name


def test_the_hands_are_mirror_images():
    curves = np.stack(list(SHAPES.values()))
    twist = np.zeros((len(curves), 12))
    left, right = (finger_rotations(side, curves, twist) for side in ("left", "right"))
    mirror = np.diag([-1.0, 1.0, 1.0])
    for finger in ("index", "middle", "ring", "pinky", "thumb"):
        for k in (1, 2, 3):
            a, b = left[JOINT_INDEX[f"left_{finger}{k}"]], right[JOINT_INDEX[f"right_{finger}{k}"]]
            np.testing.assert_allclose(mirror @ a @ mirror, b, atol=1e-9)


def spoken(*sentences: str) -> tuple[SpokenWord, ...]:
    """Words without sound, half a second each, all of them stressed."""
    texts = [(text, n) for n, sentence in enumerate(sentences) for text in words_of(sentence)]
    return tuple(
        SpokenWord(text, 0.5 * k, 0.5 * k + 0.4, 0.5 * k + 0.1, n, accent=0.8)
        for k, (text, n) in enumerate(texts)
    )


def test_a_contrast_has_two_halves_and_a_plain_sentence_none():
    words = spoken("The soup is good.", CONTRAST)
    halves = contrast_halves(words)
    assert {words[k].text for k, half in halves.items() if half > 0} >= {"some", "bread"}
    assert {words[k].text for k, half in halves.items() if half < 0} >= {"others", "sauce"}
    assert all(words[k].sentence == 1 for k in halves)


def test_the_halves_go_to_the_two_sides_and_words_keep_their_side():
    words = spoken(CONTRAST, "Taste the sauce and the bread.")
    places = GestureSelector(words, (), ANNA, np.random.default_rng(0))
    at = {(word.sentence, word.text): k for k, word in enumerate(words)}
    bread, sauce = (places.aside_m(at[0, text]) for text in ("bread", "sauce"))
    assert bread > 0.04  # the left, the other hand's side
    assert sauce < -0.04
    assert places.aside_m(at[1, "bread"]) > 0.04
    assert places.aside_m(at[1, "sauce"]) < -0.04


def test_a_keyword_does_not_call_the_same_gesture_again_at_once():
    words = spoken(*(["Stop, please stop, you have to stop."] * 40))
    choice = GestureSelector(words, (), ANNA, np.random.default_rng(1))
    names = [choice.gesture(range(k, k + 7))[0] for k in range(0, len(words) - 7, 7)]
    calls = [k for k, name in enumerate(names) if name == "stop"]
    assert len(calls) >= 3
    assert np.diff(calls).min() > REPEAT_MEMORY


def test_the_items_of_a_list_lie_side_by_side():
    words = spoken("We need fresh onions, sour lemons, and some old bread.", "It is good.")
    phrases = tuple(
        Phrase(range(a, b), 0.5 * a, 0.5 * b, b in (10, 13))
        for a, b in ((0, 4), (4, 6), (6, 10), (10, 13))
    )
    items = list_items(words, phrases)
    assert set(items) == set(range(10))
    assert items[3] == 1.0
    assert items[4] == 0.0
    assert items[9] == -1.0
    places = GestureSelector(words, phrases, ANNA, np.random.default_rng(0))
    assert places.aside_m(3) > 0.04 > -0.04 > places.aside_m(9)


def test_left_and_right_are_sides_and_right_now_is_not():
    words = spoken("Turn left at the church, the door is on the right, right now.")
    found = {words[k].text + str(k): side for k, side in directions(words, 1.0).items()}
    assert found == {"left1": 1.0, "right10": -1.0}


def test_a_contrast_calls_the_hand_of_its_side():
    choice = GestureSelector(spoken(CONTRAST), (), PEOPLE["milo"], np.random.default_rng(5))
    left = [choice.hands(GESTURES["offer"], 0.08, 1) == ["left"] for _ in range(300)]
    assert np.mean(left) > 0.7


def uttered(accents: list[float]) -> Utterance:
    """One phrase of words of half a second; each begins with its stressed vowel."""
    words = tuple(
        SpokenWord("lamp", 0.5 + k * WORD_S, 0.5 + (k + 1) * WORD_S, 0.5 + k * WORD_S, 0, accent)
        for k, accent in enumerate(accents)
    )
    phrase = Phrase(range(len(words)), words[0].start_s, words[-1].end_s, True)
    waveform = np.zeros(round((words[-1].end_s + 1.0) * SAMPLE_RATE))
    return Utterance(waveform, (), words, (phrase,))


def plan(accents: list[float], seed: int) -> HandPlan:
    return make_plan(uttered(accents), PEOPLE["ben"], np.random.default_rng(seed))


def test_unstressed_words_bring_no_gesture_and_no_beat():
    for seed in range(10):
        keys = plan([0.0] * 12, seed).keys
        assert not {key.phase for side in SIDES for key in keys[side]} & {"stroke", "beat"}


def test_every_stressed_chunk_brings_a_stroke_on_its_stressed_vowel():
    for seed in range(10):
        keys = plan([0.0, 0.0, 1.0, 0.0], seed).keys
        apexes = [key.arrive_s for side in SIDES for key in keys[side] if key.phase == "stroke"]
        assert any(abs(apex - 1.5) < 0.15 for apex in apexes), (seed, apexes)
