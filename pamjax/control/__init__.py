"""Commands for a controller: the inverse model and its uncertainty."""
