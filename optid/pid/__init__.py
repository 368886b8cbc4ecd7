"""The discrete PID controller: one definition that runs, is optimised, and is exported."""
