"""Names of the attribute terms; importable at no cost by parameter tables and messages.

============  ==========================================================================  ========
term          attribute history of a track, and how it takes in a detection                distance
============  ==========================================================================  ========
none          none                                                                        no
dsm_classic   masses on the free DSm model, classic DSm rule (Tchamova et al. 2004, 14.3)  yes
dsm_hybrid    masses on Shafer's model, hybrid DSm rule (14.3.2.2)                        yes
dempster      masses on Shafer's model, Dempster's rule                                   yes
yager         masses on Shafer's model, Yager's rule: conflict becomes ignorance          yes
dubois_prade  masses on Shafer's model, Dubois and Prade's rule: conflict goes to unions  yes
pcr5, pcr6    masses on Shafer's model, conflict is given back in proportion              yes
bayes         class probabilities, Bayes' rule (Mahler 2011, (93), (94))                  no
============  ==========================================================================  ========
"""

from __future__ import annotations

# Terms with masses, and so with a distance of history and candidate history (Tchamova et al. 2004,
# 14.4.2), by the rule of combination (see ``gda_tracker.evidence.destinations``).
RULE_OF_TERM = {
    "dsm_classic": "dsmc",
    "dsm_hybrid": "dsmh",
    "dempster": "dempster",
    "yager": "yager",
    "dubois_prade": "dubois_prade",
    "pcr5": "pcr5",
    "pcr6": "pcr6",
}
DISTANCE_TERMS = tuple(RULE_OF_TERM)

ATTRIBUTE_TERMS = ("none", *DISTANCE_TERMS, "bayes")
