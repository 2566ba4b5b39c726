"""The packages arranged as an installation has them."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
OWN = ("vehicles", "transport", "scenarios")


def arrange(site: Path) -> Path:
    site.mkdir()
    for name in OWN:
        (site / name).symlink_to(ROOT / name)
    (site / "convoy").symlink_to(ROOT / "scenarios" / "api")
    return site
