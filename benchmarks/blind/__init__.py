"""Blind naming: somebody who sees nothing but pictures says what they show; a score says how often rightly.

    python -m benchmarks.blind make FOLDER [--seeds 2] [--count 96] [--quality standard]
    python -m benchmarks.blind score FOLDER [--answers answers.csv ...]

`make` makes results of every kind through the front door and writes into FOLDER uncaptioned sheets in random
order, `questions.md` and `kinds.txt` for the namers, who get these three alone, and `key.json`, which they
must not see.
`score` compares their answers with the key. It is no benchmark that `make bench` could run: people, or models
that look at pictures, take part.
"""
