"""Design of a study: plan, trials, balance, blind ids, key; imports no other room of `study`."""
