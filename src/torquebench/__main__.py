"""`python -m torquebench`: the same commands as `torquebench`."""

from torquebench.cli import main

if __name__ == "__main__":
    main()
