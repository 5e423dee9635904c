"""Long work: runs of emulated boards, traces, replays, imports, each in a process of its own that calls the library."""
