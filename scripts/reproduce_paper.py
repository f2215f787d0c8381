"""Run the paper's simulations again: the same as `massid paper`.

python scripts/reproduce_paper.py --out paper_out
python scripts/reproduce_paper.py --only C --out paper_out
"""

import sys

from massid.cli import main

if __name__ == "__main__":
    sys.exit(main(["paper", *sys.argv[1:]]))
