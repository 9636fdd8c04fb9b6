"""Many jobs: each a command of `recon` in a process of its own, spread over workers by dask.distributed.

jobs.py      a TOML file, a CSV file, or files and a template        -> Job
words.py     a Job checked against its command's options             -> words of a command line, files they read
records.py   key of a job; the record that says that it is finished, and for which key
attempt.py   on a worker: the command in a child process, watched, its files put in place, the record last
cluster.py   the workers · run.py  from jobs to summary · summary.py  CSV and HTML

DIR/NAME/           outputs of a job, log.txt, result.json (the record: there last, so that it vouches for the rest)
DIR/.attempts/      where commands work; what an earlier run left there is swept away
DIR/journal.jsonl   a line for every start and end · DIR/summary.csv, summary.html
"""
