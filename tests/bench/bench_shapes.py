"""Errors of fits on shapes of known truth: `python -m tests.bench.bench_shapes [DRAWS]`.

Prints the root mean square error at the car and at the end of the preview, and its ratio to that of
least squares with the known shape, a lower bound for unbiased fits.
"""

import sys

from tests.made.vehicles.true_shapes import JUMPING, SMOOTH, drawn

DRAWS = 300


def main(arguments: list[str]) -> int:
    draws = int(arguments[0]) if arguments else DRAWS
    print(f"{f'{draws} draws of each':16s}{'at the car, mm':>24s}{'at the end, mm':>26s}")
    print(f"{'':16s}" + 2 * f"{'fit':>10s}{'bound':>8s}{'ratio':>8s}")
    for name, kind in {**SMOOTH, **JUMPING}.items():
        row = drawn(kind, draws)
        print(f"{name:16s}", end="")
        for error, bound, ratio in zip(row.errors, row.bounds, row.ratios, strict=True):
            print(f"{1e3 * error:10.1f}{1e3 * bound:8.1f}{ratio:8.2f}", end="")
        print()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
