"""The program gusjob, also as python -m gusjob."""

import gc

# New objects between two searches for garbage: importing makes many, none of which is garbage.
gc.set_threshold(200_000)

from gusjob.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
