"""What is freed stays with the process."""

import subprocess
import sys

import pytest

RESIDENT = """
import sys
from pathlib import Path
import torch
from usvnet.allocator import keep_freed_memory

def resident_pages():
    return int(Path("/proc/self/statm").read_text().split()[1])

kept = sys.argv[1] == "keep" and keep_freed_memory()
before = resident_pages()
blocks = [torch.ones(1 << 24) for _ in range(4)]
held = resident_pages() - before
del blocks
print(int(kept), (resident_pages() - before) / held)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads resident memory as Linux tells it")
def test_freed_memory_stays():
    shares = {}
    for mode in ("keep", "give back"):
        command = [sys.executable, "-c", RESIDENT, mode]
        kept, share = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
        if mode == "keep" and kept == "0":
            pytest.skip("this C library has no mallopt")
        shares[mode] = float(share)
    assert shares["keep"] > 0.8
    assert shares["give back"] < 0.2
