from .bits import Chromosome as Chromosome
from .bits import binary_from_gray as binary_from_gray
from .bits import gray_from_binary as gray_from_binary
from .exceptions import FitnessError as FitnessError
from .exceptions import GAError as GAError
from .exceptions import InfeasiblePopulationError as InfeasiblePopulationError
from .exceptions import ParameterError as ParameterError
from .run import GAResult as GAResult
from .run import Generation as Generation
from .run import History as History
from .run import maximize as maximize

__version__: str
