"""What is freed stays with the process, until it is given back."""

import subprocess
import sys

import pytest

RESIDENT = """
import sys
from pathlib import Path
import torch
from usvnet.allocator import give_back_freed_memory, keep_freed_memory

def resident_pages():
    return int(Path("/proc/self/statm").read_text().split()[1])

kept = sys.argv[1] != "default" and keep_freed_memory()
before = resident_pages()
blocks = [torch.ones(1 << 24) for _ in range(4)]
held = resident_pages() - before
blocks = blocks[2:3]
if sys.argv[1] == "give back":
    give_back_freed_memory()
print(int(kept), (resident_pages() - before) / held)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads resident memory as Linux tells it")
def test_freed_memory_stays_until_it_is_given_back():
    shares = {}
    for mode in ("keep", "give back", "default"):
        command = [sys.executable, "-c", RESIDENT, mode]
        kept, share = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
        if mode == "keep" and kept == "0":
            pytest.skip("this C library has no mallopt")
        shares[mode] = float(share)
    assert shares["keep"] > 0.8
    assert shares["give back"] < 0.3  # one block of four is in use still
    assert shares["default"] < 0.3
