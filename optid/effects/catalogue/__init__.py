"""One file per effect; `optid.effects.library` finds them here."""
