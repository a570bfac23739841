"""``python -m truestand``: the command line."""

from truestand.cli.main import main

if __name__ == "__main__":
    main()
