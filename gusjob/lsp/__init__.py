"""A language server: what the tool knows of a job, told to an editor while the job is written."""
