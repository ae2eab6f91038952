"""Write the weights of a checkpoint in float16, to be passed on: scripts/pack_checkpoint.py best.ckpt usvnet-n.pt."""

import argparse
from pathlib import Path

from usvnet.checkpoints import pack_checkpoint, sha256
from usvnet.files import run_program


def main() -> None:
    """Pack, and print size and SHA-256 for the model card."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    pack_checkpoint(options.checkpoint, options.output)
    print(f"{options.output}: {options.output.stat().st_size / 1e6:.2f} MB, SHA-256 {sha256(options.output)}")


if __name__ == "__main__":
    run_program(main)
