"""Topic maps: which topic plays which role, from presets and YAML files."""
