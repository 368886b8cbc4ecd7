"""Which experiment to run next: the reference that tells rival effects apart best."""
