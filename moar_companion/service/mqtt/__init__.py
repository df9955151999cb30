"""Publications and orders over MQTT: topics, payloads, orders, and the fleet of `watch`.

Pure. `service/mqtt_client` has the connection; `configs/MQTT.md` is the manual.
"""
