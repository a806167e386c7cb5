"""Where ideas are put: the halves of a contrast lie apart, and an idea keeps its place."""

from dataclasses import replace

import numpy as np

from tools.corpus.gesture.choice import (
    STALE,
    Choice,
    Places,
    contrast_halves,
    directions,
    list_items,
)
from tools.corpus.gesture.gestures import GESTURES, KEYWORDS
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.people.voice import words_of
from tools.corpus.words.prosody import Phrase, Word

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
    places = Places(words, (), ANNA, np.random.default_rng(0))
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
    assert 0.2 < literal < 0.85


def test_a_place_on_the_weak_side_can_call_the_weak_hand() -> None:
    milo = next(s for s in SPEAKERS if s.name == "milo")
    choice = Choice(milo, np.random.default_rng(3))
    left = [choice.hands(GESTURES["precise"], 0.06) == ["left"] for _ in range(400)]
    right = [choice.hands(GESTURES["precise"], -0.06) == ["left"] for _ in range(400)]
    assert np.mean(left) > np.mean(right) + 0.3


def test_a_stressed_word_is_obeyed_more_often() -> None:
    def share(accent: float) -> float:
        words = tuple(
            replace(word, accent=accent) for word in spoken(*(["Please stop that noise."] * 200))
        )
        choice = Choice(ANNA, np.random.default_rng(4))
        names = [choice.gesture(range(k, k + 4), words)[0] for k in range(0, len(words) - 4, 4)]
        return float(np.mean([name == "stop" for name in names]))

    assert share(1.0) > 1.25 * share(0.1) > 0


def test_the_items_of_a_list_lie_side_by_side() -> None:
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
    places = Places(words, phrases, ANNA, np.random.default_rng(0))
    assert places.aside_m(3) > 0.04 > -0.04 > places.aside_m(9)
    assert not places.contrasts(3)


def test_left_and_right_are_sides_and_right_now_is_not() -> None:
    words = spoken("Turn left at the church, the door is on the right, right now.")
    found = {words[k].text + str(k): side for k, side in directions(words, 1.0).items()}
    assert found == {"left1": 1.0, "right10": -1.0}


def test_a_contrast_calls_the_hand_of_its_side() -> None:
    milo = next(s for s in SPEAKERS if s.name == "milo")
    choice = Choice(milo, np.random.default_rng(5))
    left = [choice.hands(GESTURES["offer"], 0.08, contrasts=True) == ["left"] for _ in range(300)]
    assert np.mean(left) > 0.7
