"""Which of Mitsuba's engines this machine can run, found out safely.

``cuda_ad_rgb`` needs an NVIDIA GPU, ``llvm_ad_rgb`` an LLVM library that fits the installed Mitsuba, ``scalar_rgb``
nothing. An LLVM that does not fit aborts the whole process, which no ``try`` can catch, so each engine is first asked
to draw a tiny picture in a child process.
"""

import functools
import importlib.util
import os
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version

ENGINES = ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")
"""From the fastest to the one that always works."""
ENGINE_VARIABLE = "USVNET_ENGINE"
"""Environment variable that names the engine to use without asking; workers inherit the parent's choice by it."""
THREADS_VARIABLE = "OMP_NUM_THREADS"
"""Environment variable that limits the renderer's threads, as it does those of the other libraries."""
PACKAGES = ("mitsuba", "drjit", "pyoidn")

PROBE = """
import sys, mitsuba as mi
mi.set_variant(sys.argv[1])
scene = mi.load_dict({"type": "scene", "light": {"type": "constant"}, "shape": {"type": "sphere"},
                      "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}}})
print("drew", float(mi.TensorXf(mi.render(scene, integrator=mi.load_dict({"type": "path"}), spp=1)).array[0]))
"""


def check_installed() -> None:
    """Insist on the packages that rendering needs.

    Raises:
        ValueError: one is missing.
    """
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise ValueError(f"rendering needs {' and '.join(missing)}: pip install 'usvnet[sim]'")


@functools.cache
def try_engine(name: str) -> str:
    """Draw a tiny picture with an engine in a child process; the empty string, or why it failed."""
    try:
        run = subprocess.run(
            [sys.executable, "-c", PROBE, name], capture_output=True, text=True, timeout=120, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired:
        return "it did not finish a picture of 64 pixels in two minutes"
    if run.returncode == 0 and "drew" in run.stdout:
        return ""
    last = (run.stderr.strip().splitlines() or ["no message"])[-1]
    return f"the process was aborted: {last}" if run.returncode < 0 else last


@functools.cache
def choose_engine() -> str:
    """The fastest engine that works here, or the one that ``USVNET_ENGINE`` names.

    Raises:
        ValueError: a package is missing, ``USVNET_ENGINE`` names no engine, or not even ``scalar_rgb`` works.
    """
    check_installed()
    asked = os.environ.get(ENGINE_VARIABLE)
    if asked:
        if asked not in ENGINES:
            raise ValueError(f"{ENGINE_VARIABLE} is {asked}, expected {', '.join(ENGINES)}")
        return asked
    for name in ENGINES:
        if not try_engine(name):
            return name
    raise ValueError(f"Mitsuba draws with none of its engines here: {try_engine(ENGINES[-1])}")


def start_engine() -> str:
    """Make Mitsuba ready in this process and return the engine's name."""
    engine = choose_engine()
    import mitsuba

    if mitsuba.variant() != engine:
        mitsuba.set_variant(engine)
        import drjit

        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        drjit.set_log_level(drjit.LogLevel.Error)  # workers that compile the same kernel at once are no matter
        drjit.set_thread_count(int(os.environ.get(THREADS_VARIABLE) or os.cpu_count() or 1))
    return engine


def slow_engine_notice(engine: str) -> str:
    """One line for a user whose machine renders with the slow engine; empty for the others."""
    if engine != "scalar_rgb":
        return ""
    return "rendering with scalar_rgb, about half as fast as with LLVM: usvnet simulate --doctor says what is missing"


def versions() -> dict[str, str]:
    """What is installed of the packages that draw."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def doctor() -> list[str]:
    """What rendering uses here and how to make it faster, line by line."""
    lines = [f"{name} {number}" for name, number in versions().items()]
    if any("not installed" in line for line in lines):
        return [*lines, "to render: pip install 'usvnet[sim]'"]
    for name in ENGINES:
        reason = try_engine(name)
        lines.append(f"{name}: {f'no ({reason})' if reason else 'works'}")
    engine = choose_engine()
    forced = f" (forced by {ENGINE_VARIABLE})" if os.environ.get(ENGINE_VARIABLE) else ""
    lines.append(f"rendering uses {engine}{forced}")
    if engine == "scalar_rgb":
        lines += [
            "twice as fast with LLVM: Mitsuba 3.8 works with LLVM 15 (Debian and Ubuntu: apt install libllvm15),",
            "Mitsuba 3.9 with LLVM 19; DRJIT_LIBLLVM_PATH names the library where it is not found by itself",
        ]
    return lines
