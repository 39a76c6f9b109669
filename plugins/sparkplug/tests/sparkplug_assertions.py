"""The edge-node assertions of the Sparkplug 3.0.0 specification that don't apply, with reasons.

All others have tests in `test_sparkplug_assertions.py`.
"""

_TEMPLATES = "no templates are sent"
_DATA_SETS = "no data sets are sent"
_MQTT_5 = "MQTT 3.1.1 is used"
_PLANT = "concerns all edge nodes of a plant together; whoever names them sees to it"

NOT_APPLICABLE = {
    "intro-edge-node-id-uniqueness": _PLANT,
    "topic-structure-namespace-unique-edge-node-descriptor": _PLANT,
    "payloads-nbirth-edge-node-descriptor": _PLANT,
    "principles-persistence-clean-session-50": _MQTT_5,
    "payloads-ndeath-will-message-publisher-disconnect-mqtt50": _MQTT_5,
    "topics-nbirth-templates": _TEMPLATES,
    **{
        f"payloads-{name}": _DATA_SETS
        for name in (
            "dataset-column-size",
            "dataset-column-num-headers",
            "dataset-types-def",
            "dataset-types-num",
            "dataset-types-type",
            "dataset-types-value",
            "dataset-parameter-type-req",
            "template-dataset-value",
        )
    },
    **{
        f"payloads-template-{name}": _TEMPLATES
        for name in (
            "definition-nbirth-only",
            "definition-is-definition",
            "definition-ref",
            "definition-members",
            "definition-nbirth",
            "definition-parameters",
            "definition-parameters-default",
            "instance-is-definition",
            "instance-ref",
            "instance-members",
            "instance-members-birth",
            "instance-members-data",
            "instance-parameters",
            "version",
            "ref-definition",
            "ref-instance",
            "is-definition",
            "is-definition-definition",
            "is-definition-instance",
            "parameter-name-required",
            "parameter-name-type",
            "parameter-value-type",
            "parameter-type-value",
            "parameter-type-req",
            "parameter-value",
        )
    },
}
