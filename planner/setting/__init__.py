"""One sensor setting for one set of entities, searched for.

A setting found satisfies every constraint of its request; where none is found, the error names constraint, entity and
amount. The same request with the same seed gives the same setting.

Names are imported from their modules, so that a light one does not wait for the compiler.
"""
