"""Planning for the whole arm: its joints, links and what it carries take part (collision-free planning)."""

from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.plan_with_arm import plan_with_arm

__all__ = ["ArmPlan", "ArmSetting", "plan_with_arm"]
