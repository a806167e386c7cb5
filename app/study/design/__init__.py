"""What a study is: plan, trials, balance, blind ids, key; imports no other room of `study`."""
