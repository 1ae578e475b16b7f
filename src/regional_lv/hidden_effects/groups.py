"""Groups of the hearts of the benchmark of hidden effects, and what is judged of them."""

EFFECTS = {"singles": 1, "pairs": 2, "triples": 3, "unlisted": 0, "nulls": 0, "misread": 0}
"""Group of hearts -> how many causes of the study's catalogue their criticism has to find."""

LISTED = ("singles", "pairs", "triples", "nulls")
"""Groups whose causes are all in the catalogue that is searched."""

FAR = 3
"""Standard errors, given the other effects, from which on an effect has to be found."""

MODELS = {"averaged": "averaged", "as_it_is": "as it is", "true": "true model"}
"""Posteriors whose intervals of stiffness are judged, and what they are called."""
