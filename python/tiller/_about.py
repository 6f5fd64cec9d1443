"""What this build of the package is."""
from . import _core
from ._calls import public

instruction_set = public(_core.instruction_set, "instruction_set")
model_names = public(_core.model_names, "model_names")
version = public(_core.version, "version")
