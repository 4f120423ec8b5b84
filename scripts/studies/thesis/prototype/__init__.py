"""The question that the thesis closed too early: whether the machine as built can walk."""
