"""Copies a figure of a report into a file of its own.

    python3 experiments/gap/figure.py out/silverbox/report.html 2 docs/images/silverbox.svg

Figures are counted from 1, in the order of the report.
"""

import re
import sys
from pathlib import Path


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__.strip())
    report, number, out = sys.argv[1:]
    figures = re.findall(r"<svg.*?</svg>", Path(report).read_text(), re.DOTALL)
    if not number.isdigit() or not 1 <= int(number) <= len(figures):
        sys.exit(f"{report}: it has the figures 1 to {len(figures)}, and not {number}")
    Path(out).write_text(figures[int(number) - 1] + "\n")


if __name__ == "__main__":
    main()
