from .database import (
    BenchState as BenchState,
    Plant as Plant,
    PlantRun as PlantRun,
)
from .folders import FolderStore as FolderStore
from .forwarding import (
    Forwarded as Forwarded,
    RunFacts as RunFacts,
    facts_of as facts_of,
    forward as forward,
)
from .questions import (
    Answer as Answer,
    SpecimenFilter as SpecimenFilter,
    capability as capability,
    charts as charts,
    compare as compare,
    drift as drift,
    drift_of_kind as drift_of_kind,
    due as due,
    outliers as outliers,
    specimens as specimens,
)
from .reevaluation import (
    Reevaluation as Reevaluation,
    differences as differences,
    reevaluate as reevaluate,
)
