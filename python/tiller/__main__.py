"""python -m tiller: the tiller command."""
from ._command import main

main()
