"""Programs that each measure one simulator; those of peers run in the peers' own interpreters."""
