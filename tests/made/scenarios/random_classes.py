"""A module of classes that draw random numbers at each plug-in point that passes them in."""

CODE = """
from vehicles.driver.reactions import Extrapolate
from vehicles.driver.steering import FeedforwardFeedback, SteeringCommand
from vehicles.preview.trajectory import fit_composite

class Steers(FeedforwardFeedback):
    def __init__(self, parameters, gains, share, draw):
        super().__init__(parameters, gains)
        self.share, self.draw = share, draw

    def steer(self, errors, speed):
        command = super().steer(errors, speed)
        noise = 0.002 * self.share * (self.draw("noise") - 0.5)
        return SteeringCommand(command.steering + noise, command.feedforward, command.feedback)

class Follows:
    def __init__(self, setup, share, draw):
        self.policy, self.share, self.draw = setup.policy, share, draw

    def acceleration(self, speed, ahead):
        error = ahead.spacing - self.policy.desired(speed)
        noise = self.share * (self.draw("noise") - 0.5)
        return 0.5 * (ahead.predecessor_speed - speed) + 0.1 * error + noise

class Fuses:
    def __init__(self, *, draw):
        self.draw = draw

    def fuse(self, sources, settings):
        alpha = self.draw("alpha")
        weights = [alpha if one.place == 1 else 1.0 - alpha for one in sources]
        shared = [one._replace(weight=share) for one, share in zip(sources, weights)]
        fit = fit_composite(shared, settings)
        return [] if fit is None else [(1.0, fit)]

class Reacts(Extrapolate):
    def __init__(self, share, draw):
        self.share, self.draw = share, draw

    def mode(self, situation, usual, speed):
        return "coast" if usual == "composite" and self.draw("mode") < 0.3 else usual

    def acceleration(self, situation, mode, speed, wanted):
        return wanted + self.share * (self.draw("noise") - 0.5)
"""
"""Two of the purposes have one name, but belong to different keys."""


def random_settings(module: str) -> list[str]:
    return [
        f"control.controller={{use='{module}.Steers',share=0.5}}",
        f"control.longitudinal={{use='{module}.Follows',share=0.3}}",
        f"control.fusion='{module}.Fuses'",
        f"control.degradation.reaction={{use='{module}.Reacts',share=0.2}}",
        "speed.followers=gap",
    ]
