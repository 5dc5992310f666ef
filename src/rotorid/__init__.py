"""System identification for multirotors: flight log in, identified model out.

The public names stand in ``__init__.pyi`` and are loaded when they are first used, so that ``import rotorid`` costs
nothing. Every package below has a face of its own, such as ``rotorid.spectral`` or ``rotorid.models``.

Examples
--------
>>> import rotorid
>>> rotorid.__all__[:3]
['Channel', 'ExportSettings', 'Exported']
"""

from rotorid._faces import attach, lazy

__version__ = "0.1.0"

_FOR_PYTHON = "rotorid.settings.keywords:for_python"

__getattr__, __dir__, __all__ = lazy(__name__, functions=_FOR_PYTHON)

attach(
    {
        "FlightRecord": "rotorid.plot.accessors:RecordPictures",
        "FlightRecord.from_arrays": "rotorid.io.arrays:record_from_arrays",
        "FlightRecord.from_pandas": "rotorid.io.arrays:record_from_pandas",
        "Comparison": "rotorid.documents.compare:shown_comparison",
        "FlightTracking": "rotorid.documents.track:track_document",
        "FrequencyResponse": "rotorid.plot.accessors:ResponsePictures",
        "IdentifiedModel": "rotorid.plot.accessors:ModelPictures",
        "Review": "rotorid.documents.review:review_document",
        "Stitched": "rotorid.documents.stitched:stitched_document",
        "TimeHistory": "rotorid.plot.accessors:HistoryPictures",
        "Track": "rotorid.plot.accessors:TrackPictures",
        "Verified": "rotorid.documents.verify:verify_document",
    },
    functions=_FOR_PYTHON,
)
