"""Files of settings: the service's configuration, the vehicle; each key checked where it stands.

In: a YAML file. Out: an immutable value, or `InputError` with one line: file, key, value, what is
allowed. Read first: `yaml_file` (how a file is read), `config`, `vehicle`; what may be changed in
flight: `flight_parameters`. The site file, which
needs the planner's geometry: `planner.site`.
"""
