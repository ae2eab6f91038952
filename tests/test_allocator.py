"""Freed memory is reused instead of being fetched from the system again."""

import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
import torch
from usvnet.allocator import keep_freed_memory
kept = keep_freed_memory() if sys.argv[1] == "keep" else True
counts = []
for _ in range(5):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    torch.ones(1 << 24)
    counts.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print(int(kept), min(counts))  # the least: the system may take unused memory away by itself
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
    assert fault_counts[0] < fault_counts[1] / 2
