"""MQTT Sparkplug B: the open bench as an edge node with its two modules as devices, read-only.

`payload` encodes messages, `session` orders them, `metrics` lists the published values, `history`
stores unsent data, `publisher` connects them with a broker.
"""
