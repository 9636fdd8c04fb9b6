"""Jobs from a TOML file, from a CSV file, or from files and a template.

    [[job]]                                 name,command,inputs,outputs,options
    name = "cup"                            cup,patch,cup/*.ply,piece.step,--thickness auto
    command = "patch"
    inputs = ["cup/*.ply"]                  patterns are filled in, in the order of their names
    outputs = ["piece.step"]                names in the job's own folder
    options = ["--thickness", "auto"]       or one line, as in a shell

A template is a command line in which {path} stands for a file, {stem} for its name without and {name} with its ending:

    views {path} -o {stem}.step --all       where {path} is left out, it follows the command
"""

import csv
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from glob import has_magic
from os.path import commonpath
from pathlib import Path
from typing import Any

from recon.errors import BadOption, UnreadableFile, UnsupportedFormat
from recon.readers.content import file_text

__all__ = ["COMMANDS", "Job", "jobs_from_template", "read_jobs"]

COMMANDS = ("patch", "fit", "curve", "terrain", "voxels", "views", "check")
FIELDS = ("name", "command", "inputs", "outputs", "options")
NAME = re.compile(r"[A-Za-z0-9_][\w .+-]{0,150}(?<![ .])")
RESERVED = {"summary.csv", "summary.html", "journal.jsonl"}


@dataclass(frozen=True)
class Job:
    """One command to run.

    inputs   absolute paths
    outputs  names in the job's folder
    options  words of the command line
    folder   that relative paths in the options are meant from
    """

    name: str
    command: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    options: tuple[str, ...]
    folder: str


def read_jobs(path: Path) -> list[Job]:
    """Jobs of a TOML or CSV file, in its order; paths are relative to it.

    Raises  UnreadableFile, UnsupportedFormat, BadOption with the job that is wrong.
    """
    if path.suffix.lower() not in (".toml", ".csv"):
        raise UnsupportedFormat(str(path), (".toml", ".csv"))
    text = file_text(path)
    rows = _toml_rows(text, path) if path.suffix.lower() == ".toml" else _csv_rows(text, path)
    folder = path.resolve().parent
    jobs = [_job(row, f"{path}: job {number}", folder) for number, row in enumerate(rows, 1)]
    if not jobs:
        raise UnreadableFile(str(path), "holds no jobs", "Give each a [[job]] table, or a row")
    _refuse_equal_names(jobs, str(path))
    return jobs


def jobs_from_template(files: Sequence[Path], template: str) -> list[Job]:
    """One job for each file, or for each that a pattern finds, named after the file.

    Raises  BadOption for a template that makes no command line, UnreadableFile for a pattern that finds nothing.
    """
    paths = [Path(found) for file in files for found in _found(str(file), "JOBS", Path.cwd())]
    words = _shell_words(template, "--command")
    if not words or words[0] not in COMMANDS:
        raise BadOption("--command", f"begins with none of {', '.join(COMMANDS)}")
    if not any("{path}" in word for word in words):
        words.insert(1, "{path}")
    jobs = [_filled(words, path, name) for path, name in zip(paths, _names(paths))]
    _refuse_equal_names(jobs, "JOBS")
    return jobs


def _toml_rows(text: str, path: Path) -> list[Mapping[str, Any]]:
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as problem:
        raise UnreadableFile(str(path), f"is no TOML ({problem})") from problem
    tables = content.get("job", [])
    if set(content) - {"job"} or not isinstance(tables, list):
        raise UnreadableFile(str(path), f"holds {', '.join(content)}", "Give each job a [[job]] table and nothing else")
    return tables


def _csv_rows(text: str, path: Path) -> Iterator[Mapping[str, Any]]:
    rows = csv.DictReader(text.splitlines())
    if not set(rows.fieldnames or ()) <= set(FIELDS) or not {"name", "command"} <= set(rows.fieldnames or ()):
        raise UnreadableFile(str(path), "its first row does not name the columns", f"They are {', '.join(FIELDS)}")
    for row in rows:
        if None in row:
            raise UnreadableFile(str(path), f"line {rows.line_num} has more cells than columns")
        yield {key: value for key, value in row.items() if value}


def _job(row: Any, what: str, folder: Path) -> Job:
    if not isinstance(row, Mapping):
        raise BadOption(what, "is no table")
    name = row.get("name")
    if not isinstance(name, str) or NAME.fullmatch(name) is None or name.lower() in RESERVED:
        raise BadOption(what, f"has the name {name!r}; a name is letters, digits, spaces and . + - _, as a file has it")
    what = f"{what} ({name})"
    if unknown := set(row) - set(FIELDS):
        raise BadOption(what, f"says {min(unknown)!r}; what it may say is {', '.join(FIELDS)}")
    if row.get("command") not in COMMANDS:
        raise BadOption(what, f"has the command {row.get('command')!r}; use one of {', '.join(COMMANDS)}")
    inputs, outputs, options = (_words(row.get(key, []), f"{what}: {key}") for key in FIELDS[2:])
    return Job(
        name,
        str(row["command"]),
        tuple(found for word in inputs for found in _found(word, what, folder)),
        tuple(_output(word, what) for word in outputs),
        tuple(options),
        str(folder),
    )


def _words(value: Any, what: str) -> list[str]:
    if isinstance(value, str):
        return _shell_words(value, what)
    if not isinstance(value, list) or not all(isinstance(word, str | int | float) for word in value):
        raise BadOption(what, "is no list of words")
    return [str(word) for word in value]


def _shell_words(line: str, what: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError as problem:
        raise BadOption(what, f"cannot be parted into words ({problem})") from problem


def _found(word: str, what: str, folder: Path) -> list[str]:
    """The absolute path of a word, or of every file that it is a pattern of."""
    place = folder / word
    if not has_magic(word) or place.exists():
        return [str(place)]
    found = sorted(map(str, Path(place.anchor).glob(str(place.relative_to(place.anchor)))))
    if not found:
        raise UnreadableFile(what, f"nothing is found under {word}", "Check the pattern and the folder")
    return found


def _output(word: str, what: str) -> str:
    path = Path(word)
    if path.is_absolute() or ".." in path.parts or not path.name:
        raise BadOption(what, f"has the output {word}; outputs are names in the job's own folder")
    return word


def _filled(words: Sequence[str], path: Path, name: str) -> Job:
    """The template for one file: words with {path} are inputs, those after -o outputs, all others options."""
    inputs: list[str] = []
    outputs: list[str] = []
    options: list[str] = []
    rest = iter(words[1:])
    for word in rest:
        filled = word.replace("{stem}", path.stem).replace("{name}", path.name)
        if word in ("-o", "--output"):
            outputs.append(next(rest, "").replace("{stem}", path.stem).replace("{name}", path.name))
        elif "{path}" in word:
            inputs += _found(filled.replace("{path}", str(path)), "--command", Path.cwd())
        else:
            options.append(filled)
    outputs = [_output(word, "--command") for word in outputs]
    return Job(name, words[0], tuple(inputs), tuple(outputs), tuple(options), str(Path.cwd()))


def _names(paths: Sequence[Path]) -> list[str]:
    """Stems, or where two are equal the places of the files below the folder that all are in."""
    stems = [path.stem for path in paths]
    if len({stem.lower() for stem in stems}) == len(stems):
        return [_tame(stem) for stem in stems]
    root = commonpath([path.parent for path in paths])
    return [_tame("-".join(path.relative_to(root).parts)) for path in paths]


def _tame(text: str) -> str:
    name = re.sub(r"[^\w .+-]", "_", text, flags=re.ASCII).strip(" .")[:150]
    return name if NAME.fullmatch(name) else f"_{name}"


def _refuse_equal_names(jobs: Sequence[Job], what: str) -> None:
    """Names are compared as file systems that do not tell capitals apart compare them."""
    seen: set[str] = set()
    for job in jobs:
        if job.name.lower() in seen:
            raise BadOption(what, f"two jobs have the name {job.name}")
        seen.add(job.name.lower())
