"""optid: from recordings of a servo-pneumatic axis to a model you can trust."""
