"""CCSDS orbit and attitude ephemeris messages (OEM, AEM), keyword = value and XML: the public door.

The notation is recognised by the content, never by the name of the file. What the two messages share stands in
:mod:`.ccsds_message`, the notations in :mod:`.ccsds_kvn` and :mod:`.ccsds_xml`, the content in :mod:`.oem`
and :mod:`.aem`.
"""

from __future__ import annotations

from .aem import read_aem, write_aem_kvn, write_aem_xml
from .oem import read_oem, write_oem_kvn, write_oem_xml
from .series_tables import AttitudeTable, EphemerisTable

__all__ = [
    "AttitudeTable",
    "EphemerisTable",
    "read_aem",
    "read_oem",
    "write_aem_kvn",
    "write_aem_xml",
    "write_oem_kvn",
    "write_oem_xml",
]
