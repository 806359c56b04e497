"""What a whole job takes is reckoned from the seconds of its parts."""

from benchmarks.sd14 import whole_job
from pipeline.options.asset import Bake
from pipeline.options.nerf import TrainNerf
from pipeline.options.start import StartFit


def test_a_hand_over_takes_its_share_of_the_steps_and_encodes() -> None:
    train, views = TrainNerf(), Bake().large_views
    nothing = whole_job(12.0, 21.0, 6.0)
    assert nothing["distillation"] == train.steps * train.cameras_per_step * 12 / 60
    assert nothing["encoding"] == 0
    assert nothing["decoding"] == round(views * 21 / 60, 1)
    over = whole_job(12.0, 21.0, 6.0, 0.25)
    assert over["distillation"] == nothing["distillation"] / 4
    assert over["encoding"] == round(StartFit().views * 6 / 60, 1)
    assert over["together"] < 0.4 * nothing["together"]
