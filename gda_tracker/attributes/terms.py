"""Names of the attribute terms; importable at no cost by parameter tables and messages.

============  ==========================================================================  ========
term          attribute history of a track, and how it takes in a detection                distance
============  ==========================================================================  ========
none          none                                                                        no
dsm_classic   masses on the free DSm model, classic DSm rule (Tchamova et al. 2004, 14.3)  yes
dempster      masses on Shafer's model, Dempster's rule                                   yes
bayes         class probabilities, Bayes' rule (Mahler 2011, (94))                        no
============  ==========================================================================  ========
"""

from __future__ import annotations

ATTRIBUTE_TERMS = ("none", "dsm_classic", "dempster", "bayes")

# Terms with a distance of history and candidate history (Tchamova et al. 2004, 14.4.2).
DISTANCE_TERMS = ("dsm_classic", "dempster")
