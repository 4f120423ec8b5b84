"""Evolution of smooth policies on the compiled simulator, from nothing."""
