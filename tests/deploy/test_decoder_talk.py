"""What decoders write past Python is kept off the screen and counted; all else is seen."""

import os
import subprocess
import sys

import pytest

from usvnet.deploy.decoder_talk import DecoderTalk, decoder_talk

SAID = b"""[h264 @ 0x55d6] error while decoding MB 33 20, bytestream -7
    Last message repeated 2 times
[tcp @ 0x55d6] Connection to tcp://127.0.0.1:9 failed: Connection refused
    Last message repeated 4 times
[mov,mp4,m4a,3gp,3g2,mj2 @ 0x55c1] moov atom not found
[ WARN:0@0.023] global cap_ffmpeg.cpp:219 write FFmpeg: Failed to write frame
[usvnet] a line of somebody else
"""

TALKING = """
import os, sys
from usvnet.deploy.decoder_talk import decoder_talk

before = sys.stderr
with decoder_talk() as talk:
    os.write(2, b"[h264 @ 0x55d6] error\\nfrom C\\n")
    print("from Python", file=sys.stderr)
assert sys.stderr is before and talk.complaints == 1
print("afterwards", file=sys.stderr)
"""


def test_lines_of_decoders_are_known_and_those_of_pictures_counted():
    talk = DecoderTalk()
    heard = [talk.hears(line) for line in SAID.splitlines()]
    assert heard == [True] * 6 + [False]
    assert talk.complaints == 4
    assert talk.told().startswith(
        "the decoder complained 4 times (first: error while decoding MB 33 20, bytestream -7)"
    )
    assert DecoderTalk().told() == ""


def test_the_rest_goes_through(capfd):
    with decoder_talk() as talk:
        os.write(2, SAID)
    os.write(2, b"[h264 @ 0x55d6] spoken later\n")
    assert talk.complaints == 4
    assert capfd.readouterr().err == "[usvnet] a line of somebody else\n[h264 @ 0x55d6] spoken later\n"


def test_python_writes_to_the_screen_itself(root):
    ended = subprocess.run([sys.executable, "-c", TALKING], capture_output=True, text=True, cwd=root)
    assert sorted(ended.stderr.splitlines()) == ["afterwards", "from C", "from Python"]
    assert ended.returncode == 0


def test_nothing_is_left_open(monkeypatch):
    opened = []
    pipe, dup = os.pipe, os.dup
    monkeypatch.setattr(os, "pipe", lambda: opened.extend(ends := pipe()) or ends)
    monkeypatch.setattr(os, "dup", lambda number: opened.append(copy := dup(number)) or copy)
    with decoder_talk():
        pass
    for number in opened:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(number)
