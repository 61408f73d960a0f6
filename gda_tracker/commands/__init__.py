"""The commands of ``gda-tracker``, one module each: ``add_arguments(parser)`` and ``run(args)``."""
