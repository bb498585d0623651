"""carved in the software that runs a lab: MADSci, PyLabRobot and SiLA 2.

Each module needs the extra of its name: `pip install 'carved-client[madsci]'`. `docs/integrations.md` is the guide.

    scheduler ──MADSci, PyLabRobot or SiLA 2──> module of this package ──HTTP──> carved

The modules keep no state of a run: what they report is read from the instrument, also after a restart of either side.
"""
