"""How robust learned policies are, in the columns of the feedback laws."""
