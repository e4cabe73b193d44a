"""The intermediate representation of a job."""
