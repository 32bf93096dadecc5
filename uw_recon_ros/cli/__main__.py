"""``python -m uw_recon_ros.cli``."""

from uw_recon_ros.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
