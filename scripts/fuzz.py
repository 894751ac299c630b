"""Fuzzes the codec and the emulated bus, guided by coverage.

scripts/study fuzz [--minutes M] [--runs N] [--seed N] [--corpus FOLDER]
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
HANG_S = 10
MAX_BYTES = 1024


def main() -> None:
    """Fuzz for as long as the command line says; a failure ends it with its input and trace."""
    parser = argparse.ArgumentParser(prog="scripts/study fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="how long (default: 10)")
    parser.add_argument("--runs", type=int, default=-1, help="end after so many inputs")
    parser.add_argument("--seed", type=int, default=0, help="0: another one each time")
    parser.add_argument(
        "--corpus",
        type=Path,
        default=ROOT / "runs" / "fuzz",
        help="inputs that were found to reach something new, and those that fail (default: "
        "runs/fuzz)",
    )
    options = parser.parse_args()
    options.corpus.mkdir(parents=True, exist_ok=True)
    inputs = options.corpus / "corpus"
    inputs.mkdir(exist_ok=True)
    try:
        import atheris
    except ImportError:
        sys.exit(
            "scripts/study fuzz: atheris is missing: .venv/bin/pip install -e '.[fuzz]' (Linux on"
            " x86-64 only)"
        )
    sys.path.insert(0, str(ROOT))
    with atheris.instrument_imports(
        include=["haptic_wall.hw.dynamixel.codec", "haptic_wall.hw.emulated"]
    ):
        from tests.hw.dynamixel import fuzzing
    for number, seed in enumerate(fuzzing.seeds()):
        (inputs / f"seed-{number:03d}").write_bytes(seed)
    atheris.Setup(
        [
            "fuzz",
            f"-max_total_time={round(60 * options.minutes)}",
            f"-runs={options.runs}",
            f"-seed={options.seed}",
            f"-timeout={HANG_S}",
            f"-max_len={MAX_BYTES}",
            "-len_control=0",
            f"-artifact_prefix={options.corpus}/",
            "-print_final_stats=1",
            str(inputs),
        ],
        fuzzing.run,
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
