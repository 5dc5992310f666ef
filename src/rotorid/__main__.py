"""``python -m rotorid``."""

from rotorid.cli.app import main

if __name__ == "__main__":
    main()
