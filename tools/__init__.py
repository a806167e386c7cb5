"""What is run once, beside the program: the corpus that the bundled weights learnt from, and the
open body. May import `model`, `renderer`, `processes` and `conventions`; nothing imports it but
`model.corpus`, which is the corpus's command."""
