"""Operations on pages: their form, their own page, and the list of all."""
