"""Record a simulated walk to MCAP: the same as `massid record`.

python scripts/record_walk.py walk.mcap --robot atlas --seconds 20 --gait random --mass-error-kg 6 --seed 0
"""

import sys

from massid.cli import main

if __name__ == "__main__":
    sys.exit(main(["record", *sys.argv[1:]]))
