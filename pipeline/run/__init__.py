"""Running a job: the stages of its chain, what has to run, the contract of a stage, what was run and how."""
