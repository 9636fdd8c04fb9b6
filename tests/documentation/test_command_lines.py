"""Every call of `recon` that a page shows is one that the program takes, and every option that a page names exists."""

import re
import shlex

import pytest
from pages import DOCS, PAGES, code_words, command_lines, name
from typer.main import get_command

from brep_export.app.cli import app

GROUP = get_command(app)
LINES = sorted({(name(page), line) for page in PAGES for line in command_lines(page)})
METHODS = sorted((DOCS / "methods").glob("*.md"))


def options_of(command):
    return {word for parameter in command.params for word in (*parameter.opts, *parameter.secondary_opts)}


ALL_OPTIONS = set().union(*map(options_of, GROUP.commands.values()), options_of(GROUP), {"--help", "-h"})


def named_options(page):
    """Options of `recon` among what a page names; other programs' own stand in whole lines."""
    return {word for words in code_words(page) for word in re.findall(r"^(--[a-z-]+)", words)}


def test_pages_show_command_lines():
    assert {line.split()[1] for _, line in LINES} >= {*GROUP.commands} - {"demo"}


@pytest.mark.parametrize(("page", "line"), LINES, ids=lambda text: text[:60])
def test_a_command_line_is_one_that_the_program_takes(page, line):
    first, *words = shlex.split(line)[1:]
    if first.startswith("-"):
        assert first in ALL_OPTIONS
        return
    assert first in GROUP.commands, f"{page}: {line}"
    if words and "--help" not in words:  # the name of a command alone is a mention
        GROUP.commands[first].make_context(first, words)


def test_other_command_lines_are_refused():
    for words, says in ((["--nope"], "No such option"), (["--method", "square"], "square"), ([], "Missing")):
        with pytest.raises(Exception, match=says):
            GROUP.commands["patch"].make_context("patch", [*words, *(["a.ply"] if words else [])])


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_an_option_that_a_page_names_exists(page):
    assert named_options(page) - ALL_OPTIONS == set()


@pytest.mark.parametrize("page", METHODS, ids=name)
def test_an_option_in_the_table_of_a_method_is_one_of_its_command(page):
    rows = re.findall(r"^\| ((?:`--[a-z-]+`(?:, )?)+) \|", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    named = {option for row in rows for option in re.findall(r"`(--[a-z-]+)`", row)}
    assert len(named) >= 5
    assert named - options_of(GROUP.commands[page.stem]) == set()
