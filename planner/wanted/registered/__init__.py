"""Registration in a plan: how surely poses will be known when values are read, while images are planned without it."""
