"""Transcripts: the same words from every format, sentences by punctuation or pauses, one sentence for a broken file."""

import json

import numpy as np
import pytest

from zeggs_jax.speech import transcript
from zeggs_jax.speech.transcript import Word

WORDS = (Word("Hello", 0.25, 0.5), Word("there.", 0.5, 1.0), Word("I", 2.0, 2.125), Word("go!", 2.125, 3.0))


def objects(key: str = "text") -> list[dict]:
    return [{key: word.text, "start": word.start, "end": word.end} for word in WORDS]


LONG_GRID = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 3
tiers? <exists>
size = 2
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 3
        intervals: size = {count}
{intervals}
    item [2]:
        class = "TextTier"
        name = "beats"
        xmin = 0
        xmax = 3
        points: size = 1
        points [1]:
            number = 0.5
            mark = "a ""loud"" 7 one"
"""


def long_grid() -> str:
    spans = [("", 0.0, 0.25), *WORDS[:2], ("sil", 1.0, 2.0), *WORDS[2:]]
    lines = [
        f'        intervals [{k}]:\n            xmin = {a}\n            xmax = {b}\n            text = "{text}"'
        for k, (text, a, b) in enumerate(spans, 1)
    ]
    return LONG_GRID.format(count=len(spans), intervals="\n".join(lines))


def short_grid(name: str = "speaker - words") -> str:
    head = ['File type = "ooTextFile"', 'Object class = "TextGrid"', "", 0, 3, "<exists>", 1, '"IntervalTier"']
    head += [f'"{name}"', 0, 3, 4]
    lines = [*head, *(value for word in WORDS for value in (word.start, word.end, f'"{word.text}"'))]
    return "".join(f"{line}\n" for line in lines)


SRT = """1
00:00:00,250 --> 00:00:00,500
<i>Hello</i>

2
00:00:00,500 --> 00:00:01,000 X1:40 X2:600
{\\an8}there.

3
00:00:01,000 --> 00:00:02,000
♪ [music] ♪

4
00:00:02,000 --> 00:00:02,125
- I
5
00:00:02,125 --> 00:00:03,000
go!
"""
VTT = """WEBVTT - a talk

STYLE
::cue { color: red }

NOTE nothing of this is said

00:00.250 --> 00:00.500 align:start
<v Ann>Hello

first
00:00:00.500 --> 00:00:01.000
there.

00:02.000 --> 00:02.125
I

00:02.125 --> 00:03.000
go!

NOTE the end
"""
FILES = {
    "corpus.json": json.dumps({"style": "old", "words": [one | {"stressed": True} for one in objects()]}),
    "list.json": json.dumps(objects("word")),
    "whisper.json": json.dumps(
        {"text": "any", "segments": [{"text": "-", "words": objects("word")[:2]}, {"words": objects("word")[2:]}]}
    ),
    "genea.tsv": "".join(f"{word.start}\t{word.end}\t{word.text}\n" for word in WORDS),
    "long.TextGrid": long_grid(),
    "short.TextGrid": short_grid(),
    "words.srt": SRT,
    "words.vtt": VTT,
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16"])
def test_every_format_gives_the_same_words(tmp_path, name, coding):
    (tmp_path / name).write_text(FILES[name], encoding=coding)
    assert transcript.read(tmp_path / name) == WORDS


def test_the_whole_text_lends_its_punctuation(tmp_path):
    words = [one | {"text": one["text"].strip(".!").lower()} for one in objects()]
    for text, first in (("Hello there. I go! And on.", "there."), ("Hello you. I go!", "there")):
        (tmp_path / "a.json").write_text(json.dumps({"text": text, "words": words}))
        assert transcript.read(tmp_path / "a.json")[1].text == first


def test_words_without_times_lie_between_their_neighbours(tmp_path):
    """WhisperX leaves digits without times."""
    words = [objects("word")[0], {"word": "42"}, *objects("word")[2:]]
    (tmp_path / "a.json").write_text(json.dumps({"segments": [{"text": "", "words": words}]}))
    assert transcript.read(tmp_path / "a.json")[1] == Word("42", 0.5, 2.0)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.tsv", "start\tend\ttext\n1000\t3000\tab cdef.\n"),
        ("a.json", json.dumps({"segments": [{"start": 1, "end": 3, "text": " ab cdef."}]})),
        ("a.srt", "1\n00:00:01,000 --> 00:00:03,000\nab\ncdef.\n"),
        ("a.vtt", "WEBVTT\r\n\r\n00:01.000 --> 00:03.000\r\nab <b>cdef.</b>\r\n"),
    ],
)
def test_words_of_a_timed_segment_share_its_time_by_their_letters(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    first, second = transcript.read(tmp_path / name)
    assert (first.text, second.text) == ("ab", "cdef.")
    np.testing.assert_allclose([*first[1:], *second[1:]], [1.0, 1.0 + 4 / 7, 1.0 + 4 / 7, 3.0])


def test_subtitles_tell_hours_and_parts_of_a_second(tmp_path):
    (tmp_path / "a.srt").write_text("1\n01:02:03,5 --> 01:02:03,750\nlate\n")
    assert transcript.read(tmp_path / "a.srt") == (Word("late", 3723.5, 3723.75),)


def test_sentences_keep_every_word_in_order():
    found = transcript.sentences(WORDS)
    assert [one.text for one in found] == ["Hello there.", "I go!"]
    assert (found[1].start, found[1].end) == (2.0, 3.0)
    assert tuple(word for one in found for word in one.words) == WORDS


def test_punctuation_counts_before_pauses_and_within_quotes():
    words = (Word("he", 0.0, 1.0), Word('said:"go."', 9.0, 9.5), Word("then", 9.5, 10.0))
    assert [one.text for one in transcript.sentences(words)] == ['he said:"go."', "then"]


@pytest.mark.parametrize(("pause", "count"), [(0.75, 1), (0.5, 2)])
def test_pauses_part_what_is_not_punctuated(pause, count):
    words = (Word("a", 0.0, 1.0), Word("b", 1.0, 1.0), Word("c", 1.75, 2.0))
    assert len(transcript.sentences(words, pause)) == count


def test_no_words_are_no_sentences():
    assert transcript.sentences(()) == ()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.json", "{", "is not JSON"),
        ("a.json", "3", "has no timed words in a known form"),
        ("a.json", "{}", "has no timed words"),
        ("a.json", '{"words": [{"start": 0, "end": 1}]}', "has no timed words"),
        ("a.json", '{"words": [3]}', "has no timed words"),
        ("a.json", '{"words": []}', "there are no words in it"),
        ("a.json", '{"words": [{"text": "a", "start": "x", "end": 1}]}', "could not convert"),
        ("a.json", '{"words": [{"text": "a", "start": 2, "end": 1}]}', "word 1, 'a', lasts from 2 to 1 s"),
        ("a.json", '{"words": [{"text": "a", "start": NaN, "end": 1}]}', "lasts from nan to 1 s"),
        ("a.json", '{"words": [{"text": "a", "start": -1, "end": 1}]}', "lasts from -1 to 1 s"),
        ("a.json", '{"words": [{"text": "a", "start": 0, "end": Infinity}]}', "to inf s"),
        ("a.tsv", "1\t2\ta\n0\t1\tb\n", "word 2, 'b', starts at 0 s, before the one before it"),
        ("a.tsv", "0\t1\ta\n1 2 b\n", "line 2 is not start, end and word"),
        ("a.tsv", "", "there are no words in it"),
        ("a.TextGrid", "hello", "has no timed words in a known form"),
        ("a.TextGrid", '"ooTextFile"\n"Sound"\n', "not a TextGrid"),
        ("a.TextGrid", long_grid()[:600], "has no timed words in a known form"),
        ("a.TextGrid", long_grid().replace('"words"', '"phones"').replace("Text" + "Tier", "IntervalTier"), "known"),
        ("a.TextGrid", short_grid().replace('"IntervalTier"', '"TextTier"'), "tiers none|known form"),
        ("a.doc", "1", "is no transcript that can be read; give .json"),
        ("a.srt", "1", "there are no captions in it"),
        ("a.srt", "1\n00:00:01,000 --> 2 s\nhello\n", "line 2 is not a caption's times"),
        ("a.vtt", "WEBVTT\n\n00:01.000 --> 00:02.000\n[music]\n", "there are no words in it"),
        ("a.srt", "1\n00:00:02,000 --> 00:00:01,000\nhello\n", "lasts from 2 to 1 s"),
    ],
)
def test_a_broken_transcript_is_one_sentence(tmp_path, name, content, told):
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=told) as caught:
        transcript.read(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_tiers_of_which_none_is_called_words(tmp_path):
    tier = short_grid("phones").split("<exists>\n1\n")
    (tmp_path / "a.TextGrid").write_text(f"{tier[0]}<exists>\n2\n{tier[1]}{tier[1].replace('phones', 'tones')}")
    with pytest.raises(ValueError, match="tiers 'phones', 'tones'; call the one with words 'words'"):
        transcript.read(tmp_path / "a.TextGrid")


def test_a_file_that_is_not_there_or_no_text(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"'.*a\.json' does not exist"):
        transcript.read(tmp_path / "a.json")
    (tmp_path / "b.tsv").write_bytes(b"\xff\x00\xfa")
    with pytest.raises(ValueError, match="not text in UTF-8"):
        transcript.read(tmp_path / "b.tsv")
