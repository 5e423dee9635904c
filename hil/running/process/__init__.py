"""The process that the loop runs in: started, told what to do, followed, and kept to its deadlines."""
