"""What a sceptic would try instead of the diagnosis; each is called as `optid diagnose` is and answers in its form."""
