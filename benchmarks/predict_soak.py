"""A long run of ``usvnet predict`` on a stream that loops and breaks off: memory, and every frame accounted for.

    python benchmarks/predict_soak.py --video sea.mp4 --camera front.yaml --checkpoint best.ckpt --seconds 600 --cuts 5

A server in this process sends the video as MJPEG over HTTP on the loopback, at its own pace, and cuts the line at even
intervals. The program runs in a process of its own; Ctrl-C ends it. Linux only (/proc).
"""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
from jsonargparse import auto_cli

BOUNDARY = "frame"


class Loop:
    """A video as JPEGs, over and over, while the line is up."""

    def __init__(self, video: Path, most_frames: int) -> None:
        capture = cv2.VideoCapture(str(video))
        self.frames_per_s = capture.get(cv2.CAP_PROP_FPS)
        self.pictures: list[bytes] = []
        while len(self.pictures) < most_frames and (read := capture.read())[0]:
            self.pictures.append(cv2.imencode(".jpg", read[1])[1].tobytes())
        if not self.pictures:
            raise ValueError(f"{video}: not a video that OpenCV can read")
        self.up = threading.Event()
        self.up.set()
        self.sent = 0

    def serve(self) -> ThreadingHTTPServer:
        """Start a server; its port is free."""
        loop = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if not loop.up.is_set():
                    self.send_error(503)
                    return
                self.send_response(200)
                self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
                self.end_headers()
                due_s = time.monotonic()
                while loop.up.is_set():
                    picture = loop.pictures[loop.sent % len(loop.pictures)]
                    head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
                    try:
                        self.wfile.write(head.encode() + picture + b"\r\n")
                    except OSError:
                        return
                    loop.sent += 1
                    due_s += 1 / loop.frames_per_s
                    time.sleep(max(0.0, due_s - time.monotonic()))

            def log_message(self, *_: object) -> None:
                """Keep quiet."""

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return server


def main(
    video: Path,
    camera: Path,
    checkpoint: Path,
    output: Path = Path("runs/soak"),
    seconds: float = 600.0,
    cuts: int = 5,
    cut_s: float = 3.0,
    every_s: float = 10.0,
    save: str = "video",
    options: list[str] | None = None,
) -> None:
    """Run, cut, watch and account.

    Args:
        video: what the stream shows.
        camera: its camera file.
        checkpoint: written by train.py.
        output: folder of the predictions and of ``soak.json``.
        seconds: length of the run, from its first frame.
        cuts: how often the line is cut.
        cut_s: how long each time.
        every_s: memory is read so often.
        save: what ``usvnet predict`` draws: video, pictures or none.
        options: further options of ``usvnet predict``.
    """
    loop = Loop(video, most_frames=250)
    server = loop.serve()
    address = f"http://127.0.0.1:{server.server_address[1]}/"
    command = [sys.executable, "-m", "usvnet.cli", "predict", address, "--camera", str(camera), "--save", save]
    command += ["--checkpoint", str(checkpoint), "--output", str(output), *(options or [])]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    heard: list[str] = []
    threading.Thread(target=lambda: heard.extend(program.stderr or []), daemon=True).start()
    while not loop.sent and program.poll() is None:
        time.sleep(0.1)
    began_s = time.monotonic()
    cut_at_s = [seconds * (n + 1) / (cuts + 1) for n in range(cuts)]
    memory_mb: list[tuple[float, float]] = []
    while program.poll() is None and (now_s := time.monotonic() - began_s) < seconds:
        if cut_at_s and now_s >= cut_at_s[0]:
            del cut_at_s[0]
            loop.up.clear()
            threading.Timer(cut_s, loop.up.set).start()
        if now_s >= len(memory_mb) * every_s:
            memory_mb.append((round(now_s, 1), resident_mb(program.pid)))
        time.sleep(0.05)
    if program.poll() is None:
        program.send_signal(signal.SIGINT)
    said = program.communicate()[0]
    server.shutdown()
    figures = account(said, heard, output, loop.sent, memory_mb) | {"exit_code": program.returncode}
    (output / "soak.json").write_text(json.dumps(figures, indent=1) + "\n")
    print(said + json.dumps(figures, indent=1))


def resident_mb(process: int) -> float:
    """Memory of a process that is in use, 2**20 bytes."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 2**20, 1)


def account(
    said: str, heard: list[str], output: Path, sent: int, memory_mb: list[tuple[float, float]]
) -> dict[str, object]:
    """Where every frame went, and how memory moved after the first tenth of the run."""

    def counted(what: str) -> int:
        found = re.search(rf"(\d+) .*{what}", said)
        return int(found[1]) if found else 0

    numbers = [json.loads(line)["frame"] for line in (output / "predictions.jsonl").open() if '"frame"' in line]
    overtaken, unreadable = counted("overtaken"), counted("could not be read")
    settled = [megabytes for _, megabytes in memory_mb[len(memory_mb) // 10 + 1 :]]
    return {
        "sent": sent,
        "predicted": len(numbers),
        "overtaken": overtaken,
        "unreadable": unreadable,
        "received_up_to_the_last_predicted": numbers[-1] + 1,
        "unaccounted": max(0, numbers[-1] + 1 - len(numbers) - overtaken - unreadable),
        "cuts_noticed": counted("broke off"),
        "cuts_told": sum("broke off: attempt 1 " in line for line in heard),
        "returns_told": sum("is back" in line for line in heard),
        "memory_mb": memory_mb,
        "memory_first_last_ratio": round(settled[-1] / settled[0], 4) if settled else None,
        "memory_largest_smallest_ratio": round(max(settled) / min(settled), 4) if settled else None,
    }


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
