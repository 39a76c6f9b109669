"""What the commands on a plant answer with `--json`."""

from torquebench.cli.answers import ANSWERS, WITHOUT_ANSWER, Record

_FILES = {"files": [str]}
REGISTERED_BENCH = Record(
    "A bench, and the URL with which it sends.",
    facts={"number": int, "name": str, "place": str, "url": str},
)
PLANT_REGISTERED = Record("The new bench of a plant.", facts={"benches": [REGISTERED_BENCH]})
PLANT_BENCH = Record(
    "One bench of a plant.",
    "torquebench_plant:BenchState",
    "number name place entries=head.sequence runs folders last_contact replaced_by",
)
PLANT_BENCHES = Record("Benches of a plant.", facts={"benches": [PLANT_BENCH]})
PLANT_MADE = Record(
    "A plant's registry, or a user of it.",
    facts={"plant": str},
    sometimes={"folders": str, "url": str},
)
PLANT_SENT = Record(
    "Data sent by a bench.",
    "torquebench_plant:Forwarded",
    "bench entries folders bytes=size withdrawn problems chain_end=head.__str__",
)
PLANT_RUN = Record(
    "One run of a plant.",
    "torquebench_plant:PlantRun",
    "run=run_id bench kind started status specimen_type serial batch simulated",
    {"withdrawn": bool},
)
PLANT_RUNS = Record("Runs of a plant, the newest first.", facts={"runs": [PLANT_RUN]})
PLANT_WITHDRAWN = Record(
    "A run that was withdrawn, and in how many registries it was known.",
    facts={"run": str, "bench": str, "known": int},
)
PLANT_VERIFIED_BENCH = Record(
    "One bench's hash chain in the plant.",
    facts={"bench": str, "entries": int, "defects": [str]},
)
PLANT_VERIFIED = Record("All chains of a plant.", facts={"benches": [PLANT_VERIFIED_BENCH]})
PLANT_ANSWER = Record(
    "An answer of the plant as a table: names end with their unit, values are in the rows.",
    "torquebench_plant:Answer",
    "title simulated rows facts notes",
    sometimes=_FILES,
)

_PLANT_QUESTIONS = (
    "due",
    "drift",
    "specimens",
    "capability",
    "charts",
    "outliers",
    "compare",
    "reevaluate",
)

ANSWERS |= {
    "plant init": (PLANT_MADE,),
    "plant register": (PLANT_REGISTERED,),
    "plant add-reader": (PLANT_MADE,),
    "plant push": (PLANT_SENT,),
    "plant status": (PLANT_BENCHES,),
    "plant runs": (PLANT_RUNS,),
    "plant withdraw": (PLANT_WITHDRAWN,),
    "plant verify": (PLANT_VERIFIED,),
    **{f"plant {name}": (PLANT_ANSWER,) for name in _PLANT_QUESTIONS},
}
WITHOUT_ANSWER["plant view"] = "serves the plant's view until it is ended"
