"""MQTT Sparkplug B: the open bench as an edge node, its two modules as devices, nothing to write.

`payload` encodes messages, `session` orders them, `metrics` lists what is published, `history`
keeps what couldn't be sent, `publisher` connects them with a broker.
"""
