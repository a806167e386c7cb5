"""Where ideas are put: the halves of a contrast lie apart, and an idea keeps its place."""

import numpy as np

from model.corpus.gesture.choice import STALE, Choice
from model.corpus.gesture.gestures import GESTURES, KEYWORDS
from model.corpus.gesture.places import Places, contrast_halves
from model.corpus.people.speakers import SPEAKERS
from model.corpus.people.voice import words_of
from model.corpus.words.prosody import Word

ANNA = SPEAKERS[0]  # right-handed
CONTRAST = "Some people bake fresh bread, others would rather taste the sauce."


def spoken(*sentences: str) -> tuple[Word, ...]:
    """Words without sound, half a second each, all of them stressed."""
    texts = [(text, n) for n, sentence in enumerate(sentences) for text in words_of(sentence)]
    return tuple(
        Word(text, 0.5 * k, 0.5 * k + 0.4, 0.5 * k + 0.1, n, accent=0.8)
        for k, (text, n) in enumerate(texts)
    )


def test_a_contrast_has_two_halves_and_a_plain_sentence_none() -> None:
    words = spoken("The soup is good.", CONTRAST)
    halves = contrast_halves(words)
    assert {words[k].text for k, half in halves.items() if half > 0} >= {"some", "bread"}
    assert {words[k].text for k, half in halves.items() if half < 0} >= {"others", "sauce"}
    assert all(words[k].sentence == 1 for k in halves)


def test_the_halves_go_to_the_two_sides_and_words_keep_their_side() -> None:
    words = spoken(CONTRAST, "Taste the sauce and the bread.")
    places = Places(words, ANNA, np.random.default_rng(0))
    at = {(word.sentence, word.text): k for k, word in enumerate(words)}
    bread, sauce = (places.aside_m(at[0, text]) for text in ("bread", "sauce"))
    assert bread > 0.04  # the left, the other hand's side
    assert sauce < -0.04
    assert places.aside_m(at[1, "bread"]) > 0.04
    assert places.aside_m(at[1, "sauce"]) < -0.04


def test_a_keyword_does_not_call_the_same_gesture_again_at_once() -> None:
    words = spoken(*(["Stop, please stop, you have to stop."] * 40))
    choice = Choice(ANNA, np.random.default_rng(1))
    names = [choice.gesture(range(k, k + 7), words)[0] for k in range(0, len(words) - 7, 7)]
    calls = [k for k, name in enumerate(names) if name == "stop"]
    assert len(calls) >= 3
    assert np.diff(calls).min() > STALE


def test_words_are_not_always_obeyed() -> None:
    words = spoken(*(["They repeat the wonderful plan and compare the round future."] * 60))
    choice = Choice(ANNA, np.random.default_rng(2))
    called = {
        name for text in words_of("repeat wonderful plan round future") for name in KEYWORDS[text]
    }
    names = [choice.gesture(range(k, k + 9), words)[0] for k in range(0, len(words) - 9, 9)]
    literal = np.mean([name in called - {"present", "frame", "roll", "weigh"} for name in names])
    assert 0.1 < literal < 0.6


def test_a_place_on_the_weak_side_can_call_the_weak_hand() -> None:
    milo = next(s for s in SPEAKERS if s.name == "milo")
    choice = Choice(milo, np.random.default_rng(3))
    left = [choice.hands(GESTURES["precise"], 0.06) == ["left"] for _ in range(400)]
    right = [choice.hands(GESTURES["precise"], -0.06) == ["left"] for _ in range(400)]
    assert np.mean(left) > np.mean(right) + 0.3
