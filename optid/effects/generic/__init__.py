"""Effects that any site of any plant can carry, one file each; `optid.effects.library` finds them here."""
