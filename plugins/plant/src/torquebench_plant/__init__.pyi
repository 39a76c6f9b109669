from .answer import (
    Answer as Answer,
)
from .database import (
    BenchState as BenchState,
    Plant as Plant,
    PlantRun as PlantRun,
)
from .facts import (
    RunFacts as RunFacts,
    facts_of as facts_of,
)
from .folders import (
    FolderStore as FolderStore,
)
from .forwarding import (
    Forwarded as Forwarded,
    forward as forward,
)
from .production import (
    SpecimenFilter as SpecimenFilter,
    capability as capability,
    charts as charts,
    compare as compare,
    outliers as outliers,
    specimens as specimens,
)
from .reevaluating import (
    Reevaluation as Reevaluation,
    differences as differences,
    reevaluate as reevaluate,
)
from .transducers import (
    drift as drift,
    drift_of_kind as drift_of_kind,
    due as due,
)
