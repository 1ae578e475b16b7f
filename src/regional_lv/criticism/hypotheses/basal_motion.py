"""A base that widens."""

from regional_lv.criticism.hypotheses.base import SimulatorHypothesis


class BasalMotion(SimulatorHypothesis):
    name = "basal_motion"
    parameter = "radial compliance of the base"
    unit = "mm/kPa"
    base, low, high = 0.0, 0.0, 10.0
    section, key = "loading", "basal_compliance_mm_per_kpa"
    nodes = (1.0, 10.0)
    slope_at_base = False
    signature_at = 3.0  # a hardly loosened base only gives at its edge; then the ring widens
    description = (
        "The simulated base stays on its circle. The valve ring of a living heart is fibrous, not "
        "rigid: its area changes by a fifth or more in a cycle. Psi is the radial displacement "
        "per traction of a spring on the base; from 0, where it is held, the ring widens with psi "
        "up to free motion, and the basal wall thins and shortens as the rest does."
    )
    source = (
        "Levine et al. 2015, Nat Rev Cardiol 12:689-710, doi 10.1038/nrcardio.2015.161; springs "
        "at the base: Pfaller et al. 2019, doi 10.1007/s10237-018-1098-4"
    )
    half_way = 1.0
    """Compliance (mm/kPa) about which the base is as stiff as the spring."""

    def at_load(self, psi, fraction):
        return psi * fraction

    def coordinate(self, psi):
        """Share of the free motion, that of two springs in series."""
        return psi / (psi + self.half_way)

    def why_not(self, physics):
        base = physics["loading"]["base"]
        if base != "u_r_u_z_fixed":
            return f"loading.base {base} does not hold the base on its circle"
        return super().why_not(physics)
