from .database import (
    PLANT_URL as PLANT_URL,
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
