"""Studies: what fills the tables of the documents, each run from a checkout by one command."""
