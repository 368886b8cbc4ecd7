"""The field board: real recordings, what engineers accept of each, and how an answer is scored."""
