"""Every paper that the code cites by its key stands in the bibliography."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_cited_key_has_its_entry():
    entries = set(re.findall(r"@\w+\{(\w+),", (ROOT / "docs" / "bibliography.bib").read_text(encoding="utf-8")))
    sources = [path for package in ("recon", "brep_export") for path in (ROOT / package).rglob("*.py")]
    cited = {key for path in sources for key in re.findall(r"\[([a-z]+\d{4})\]", path.read_text(encoding="utf-8"))}
    assert cited and cited - entries == set()
