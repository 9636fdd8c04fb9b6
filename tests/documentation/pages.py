"""The pages of the documentation and the README, and what stands in them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """The text of a page without its blocks of code."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"^(?: {4}|\t)(?![-*] ).*$", "", text, flags=re.MULTILINE)


def code_words(page: Path) -> list[str]:
    """What stands between backquotes in the prose of a page."""
    return re.findall(r"`([^`\n]+)`", prose(page))


def blocks(page: Path, language: str = "") -> list[str]:
    """Fenced blocks of one language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def command_lines(page: Path) -> list[str]:
    """Lines that call `recon`, in blocks and between backquotes, without their comments."""
    indented = re.findall(r"^    (recon .*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    fenced = [line for block in blocks(page) for line in block.splitlines()]
    lines = [*indented, *fenced, *code_words(page)]
    return [re.sub(r"\s+#.*", "", line).strip() for line in lines if line.startswith("recon ")]
