"""Freed memory is reused instead of being fetched from the system again."""

import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
import torch
from usvnet.allocator import keep_freed_memory
kept = keep_freed_memory() if sys.argv[1] == "keep" else True
torch.ones(1 << 24)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    torch.ones(1 << 24)
print(int(kept), resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="page faults are counted as Linux counts them")
def test_kept_memory_is_not_fetched_again():
    kept, fault_counts = [], []
    for mode in ("keep", "give back"):
        answer = subprocess.run([sys.executable, "-c", FAULTS, mode], capture_output=True, text=True, check=True).stdout
        known, faults = map(int, answer.split())
        kept.append(known)
        fault_counts.append(faults)
    if not kept[0]:
        pytest.skip("this C library has no mallopt")
    assert fault_counts[0] < fault_counts[1] / 4
