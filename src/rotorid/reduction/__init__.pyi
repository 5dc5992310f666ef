from rotorid.reduction.guided import Reduced as Reduced
from rotorid.reduction.guided import Reduction as Reduction
from rotorid.reduction.guided import Step as Step
from rotorid.reduction.guided import fit_and_drop as fit_and_drop
from rotorid.reduction.guided import reduce as reduce
