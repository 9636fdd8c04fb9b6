"""Jobs as people write them, what is said of wrong ones, and what counts as finished."""

import json
import os
import shutil
from pathlib import Path

import pytest

from brep_export.app.batch.attempt import ONE_THREAD, Terms, _environment
from brep_export.app.batch.jobs import jobs_from_template, read_jobs
from brep_export.app.batch.records import RECORD, content_hash, job_key, kept_record, put_record
from brep_export.app.batch.summary import write_summary
from brep_export.app.batch.words import Order, order
from brep_export.app.commands.batch import _bytes
from recon.errors import BadOption, ReconError

LIMITS = Terms().limits


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def sherds(tmp_path):
    (tmp_path / "cup").mkdir()
    for name in ("b.ply", "a.ply"):
        write(tmp_path / "cup" / name, name)
    return tmp_path


def test_a_toml_file_and_a_csv_file_say_the_same(sherds):
    toml = write(
        sherds / "jobs.toml",
        '[[job]]\nname = "cup 1"\ncommand = "patch"\ninputs = ["cup/*.ply"]\noutputs = ["piece.step", "piece.stl"]\n'
        'options = ["--thickness", 2.5, "--name", "a cup"]\n',
    )
    csv = write(
        sherds / "jobs.csv",
        "name,command,inputs,outputs,options\n"
        "cup 1,patch,cup/*.ply,piece.step piece.stl,\"--thickness 2.5 --name 'a cup'\"\n",
    )
    (job,) = read_jobs(toml)
    assert [job] == read_jobs(csv)
    assert job.inputs == (str(sherds / "cup" / "a.ply"), str(sherds / "cup" / "b.ply"))
    assert job.options == ("--thickness", "2.5", "--name", "a cup")


def test_a_template_makes_a_job_of_every_file(sherds, monkeypatch):
    monkeypatch.chdir(sherds)
    first, second = jobs_from_template([Path("cup/*.ply")], "fit -o {stem}.step --name {name}")
    assert (first.name, second.name) == ("a", "b")
    assert order(first).words == (str(sherds / "cup" / "a.ply"), "-o", "a.step", "--name", "a.ply")
    (whole,) = jobs_from_template([Path("cup")], "patch {path}/*.ply -o piece.step --thickness auto")
    assert whole.inputs == (str(sherds / "cup" / "a.ply"), str(sherds / "cup" / "b.ply"))


def test_files_of_one_name_in_two_folders_make_jobs_of_two_names(sherds):
    (sherds / "bowl").mkdir()
    write(sherds / "bowl" / "a.ply", "a")
    jobs = jobs_from_template([sherds / "*" / "a.ply"], "fit -o out.step")
    assert [job.name for job in jobs] == ["bowl-a.ply", "cup-a.ply"]


def test_files_that_options_read_are_found_from_the_jobs_file_and_count_as_read(sherds, monkeypatch):
    monkeypatch.chdir("/")
    text = '[[job]]\nname = "a"\ncommand = "patch"\ninputs = "cup/a.ply"\noutputs = "p.step"\noptions = "%s"\n'
    for options in ("--method box --picks picks.json --picture p.png", "--method box --picks=picks.json"):
        made = order(read_jobs(write(sherds / "jobs.toml", text % options))[0])
        assert made.reads == (str(sherds / "cup" / "a.ply"), str(sherds / "picks.json"))
        assert str(sherds / "picks.json") in " ".join(made.words)
        assert str(sherds / "p.png") not in " ".join(made.words)


GOOD = '[[job]]\nname = "a"\ncommand = "fit"\ninputs = "cup/a.ply"\noutputs = "a.step"\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("[job]\n", "no list|\\[\\[job\\]\\]"),
        ("[[job]\n", "TOML"),
        ("[[jobs]]\n", "jobs"),
        ("job = [1]\n", "table"),
        (GOOD + GOOD, "two jobs have the name a"),
        (GOOD + GOOD.replace('"a"', '"A"'), "two jobs"),
        (GOOD.replace('"a"', '"../a"'), "letters"),
        (GOOD.replace('"a"', '"summary.csv"'), "name"),
        (GOOD.replace("fit", "demo"), "'demo'"),
        (GOOD.replace("fit", "batch"), "'batch'"),
        (GOOD.replace("a.step", "../a.step"), "own folder"),
        (GOOD.replace("a.step", "/a.step"), "own folder"),
        (GOOD.replace("cup/a", "cup/*.x"), "nothing is found"),
        (GOOD + 'option = "-q"\n', "'option'"),
        (GOOD + 'options = "--bogus 3"\n', "job a.*--bogus"),
        (GOOD + "options = '--name \"a'\n", "parted into words"),
        (GOOD + "options = [[1]]\n", "words"),
        (GOOD + 'options = "--help"\n', "asks for help"),
        (GOOD + 'options = "--picture /p.png"\n', "own folder"),
        (GOOD + 'options = "--timeout -3"\n', "timeout"),
    ],
)
def test_a_wrong_jobs_file_gets_one_sentence(sherds, text, says):
    with pytest.raises(ReconError, match=says):
        [order(job) for job in read_jobs(write(sherds / "jobs.toml", text))]


@pytest.mark.parametrize("text", ["name,command\n", "a,b\n1,2\n", "name,command\nx,fit,3\n", "name\nx\n"])
def test_a_wrong_table_gets_one_sentence(tmp_path, text):
    with pytest.raises(ReconError):
        read_jobs(write(tmp_path / "jobs.csv", text))


@pytest.mark.parametrize("template", ["", "demo", "fit '", "fit {path} -o ../x.step", "fit -o"])
def test_a_wrong_template_gets_one_sentence(sherds, template):
    with pytest.raises(ReconError):
        jobs_from_template([sherds / "cup" / "a.ply"], template)


def test_sizes_of_memory():
    assert (_bytes("2GB"), _bytes("1.5 GiB"), _bytes("300m"), _bytes("1024")) == (2**31, 3 * 2**29, 300 * 2**20, 1024)
    for wrong in ("", "much", "-1GB", "0", "1e3"):
        with pytest.raises(BadOption):
            _bytes(wrong)


@pytest.fixture
def finished(tmp_path):
    """A job that was done: its order, its key, its folder."""
    source = write(tmp_path / "in.csv", "0 0\n1 1\n")
    made = tmp_path / "made"
    made.mkdir()
    write(made / "out.step", "solid")
    one = Order("a", "curve", (str(source), "-o", "out.step"), (str(source),))
    content_hash.cache_clear()
    key = job_key(one)
    put_record(tmp_path / "a", made, {"key": key, "cause": "", "limits": LIMITS})
    return one, key, tmp_path / "a"


def test_a_finished_job_is_known_also_from_a_copy_and_after_a_touch(finished, tmp_path):
    one, key, folder = finished
    os.utime(one.reads[0])
    content_hash.cache_clear()
    assert job_key(one) == key
    shutil.copytree(folder, tmp_path / "copy")
    assert kept_record(tmp_path / "copy", key, LIMITS)["outputs"].keys() == {"out.step"}


def test_other_content_or_other_words_make_another_job(finished):
    one, key, folder = finished
    other = Order(one.name, one.command, (*one.words, "--degree", "2"), one.reads)
    assert kept_record(folder, job_key(other), LIMITS) is None
    write(Path(one.reads[0]), "0 0\n1 2\n")
    content_hash.cache_clear()
    assert kept_record(folder, job_key(one), LIMITS) is None
    assert key != job_key(one)


def test_outputs_that_changed_or_went_are_made_again(finished):
    _, key, folder = finished
    write(folder / "out.step", "soli")
    assert kept_record(folder, key, LIMITS) is None
    (folder / "out.step").unlink()
    assert kept_record(folder, key, LIMITS) is None


@pytest.mark.parametrize("damage", ["", "{", "[]", "null", '{"key": 3}'])
def test_a_damaged_record_vouches_for_nothing(finished, damage):
    _, key, folder = finished
    write(folder / RECORD, damage)
    assert kept_record(folder, key, LIMITS) is None


def test_what_broke_off_is_finished_for_its_limits_alone(finished):
    _, key, folder = finished
    record = json.loads((folder / RECORD).read_text()) | {"cause": "timeout", "limits": Terms(timeout=5.0).limits}
    write(folder / RECORD, json.dumps(record))
    assert kept_record(folder, key, Terms(timeout=5.0, share=7).limits) is not None
    assert kept_record(folder, key, Terms(timeout=9.0).limits) is None


def test_the_summary_links_every_file_and_shows_what_failed_first(tmp_path):
    done = {"name": "a", "command": "fit", "status": "done", "cause": "", "reasons": [], "attempts": 1, "seconds": 1.0}
    done |= {"peak_memory_mb": 9.0, "outputs": {"my part.step": "", "b.png": ""}, "answer": {"kernel": {"faces": 6}}}
    failed = {**done, "name": "<b>", "status": "failed", "cause": "crash", "reasons": ["it broke."], "outputs": {}}
    write_summary(tmp_path, [done, failed])
    page = (tmp_path / "summary.html").read_text()
    assert '<a href="a/my%20part.step">my part.step</a> <a href="a/b.png">b.png</a>' in page
    assert page.index("&lt;b&gt;") < page.index(">a</a>") and "<b>" not in page
    rows = (tmp_path / "summary.csv").read_text().splitlines()
    assert [row.split(",")[:4] for row in rows[1:]] == [["a", "fit", "done", ""], ["<b>", "fit", "failed", "crash"]]


def test_a_job_has_one_thread_and_manages_its_memory_as_any_process_does(monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")  # as Dask sets it for its workers
    monkeypatch.setenv("RECON_OWN", "kept")
    environment = _environment()
    assert "MALLOC_TRIM_THRESHOLD_" not in environment
    assert environment["RECON_OWN"] == "kept"
    assert environment | ONE_THREAD == environment
